"""Where mechanisms fall from folds, against chains of links that fall by themselves; energy, membership, symmetry."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.snaps.moving_rods import make_grid, make_moving_rods
from pcm_gym.kernels.snaps.relaxation import LANDED, RelaxationRules, relax
from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Rod
from pcm_gym.solving import BranchTracker, Equilibrium, Event, Snap, SnapStatus, snap, solve_forward
from tests.reference.dense_relaxation import CLOSING_RATE, Chains, push_over
from tests.reference.mechanisms import (
    find_equilibria,
    home_by_construction,
    random_inputs,
    random_load,
    random_mechanism,
)
from tests.reference.orders import fitted_order


def fold_on_the_way(
    name: str, inputs: list[float], load: list[float] | None = None
) -> tuple[Equilibrium, np.ndarray, np.ndarray]:
    """Return the fold between home and the inputs and load (EI / L^2), and the unit way there, as (inputs, load)."""
    home = home_by_construction(name)
    units = home.mechanism.units
    force = np.zeros(home.mechanism.dof) if load is None else np.array(load) * units.load
    step = BranchTracker(home.mechanism, home).step(inputs, force)
    assert step.event == Event.FOLD
    way = np.array(inputs) - home.inputs
    length = math.hypot(float(np.linalg.norm(way / units.inputs)), float(np.linalg.norm(force / units.load)) / 30.0)
    return step.equilibrium, way / length, force / length


FOLDS = {
    "2RFR": ("2RFR", [-0.6, -1.3], None),
    "2RFR loaded": ("2RFR", [1.4, 3.4], [-18.0, -19.0]),
    "2PFR loaded": ("2PFR", [-0.4, -0.3], [-4.0, -15.0]),
    "2PFR loaded, near": ("2PFR", [0.1, -0.2], [16.0, -15.0]),
    "3PFR": ("3PFR", [0.3, 0.4, -0.4], None),
    "3PFR loaded": ("3PFR", [0.4, 0.2, -0.3], [3.0, -25.0, 1.0]),
}


@pytest.fixture(scope="module")
def snaps() -> dict[str, tuple[Equilibrium, Snap]]:
    folds = {key: fold_on_the_way(*arguments)[0] for key, arguments in FOLDS.items()}
    return {key: (fold, snap(fold)) for key, fold in folds.items()}


class TestLanding:
    @pytest.mark.parametrize("key", FOLDS)
    def test_is_where_chains_of_links_come_to_rest(self, key: str, snaps: dict[str, tuple[Equilibrium, Snap]]) -> None:
        """Pushed a little through the fold; the landing is followed to the same inputs. The chains' error is O(h^2)."""
        fold, inputs_rate, load_rate = fold_on_the_way(*FOLDS[key])
        distances = []
        for links in (16, 32):
            rest, inputs, load = push_over(fold, inputs_rate, load_rate, links)
            step = BranchTracker(fold.mechanism, snaps[key][1].equilibrium).step(inputs, load)
            assert step.event == Event.NONE
            distances.append(np.abs(rest.joints - step.equilibrium.shape(links + 1)).max())
        assert distances[1] < 0.01 * fold.mechanism.units.length
        assert distances[1] < 0.3 * distances[0]

    @pytest.mark.parametrize("key", FOLDS)
    def test_is_stable_lower_and_reached_downhill(self, key: str, snaps: dict[str, tuple[Equilibrium, Snap]]) -> None:
        fold, found = snaps[key]
        landing = found.equilibrium
        assert found.is_landed
        assert landing.is_stable
        assert landing.residual < 1e-11
        assert np.array_equal(landing.inputs, fold.inputs)
        assert np.array_equal(landing.load, fold.load)
        assert found.energy_released == pytest.approx(fold.energy - landing.energy, rel=1e-9)
        assert found.energy_released > 0.0
        assert (np.diff(found.energies) <= 0.0).all()
        # the followed motion starts and ends at these energies, but for the first disturbance and the last polish
        assert found.energies[0] == pytest.approx(fold.energy, abs=1e-4 * fold.mechanism.units.energy)
        assert found.energies[-1] == pytest.approx(landing.energy, abs=0.05 * found.energy_released)

    @pytest.mark.parametrize("key", [key for key in FOLDS if key != "3PFR loaded"])  # that would take long
    def test_is_one_of_the_complete_forward_set(self, key: str, snaps: dict[str, tuple[Equilibrium, Snap]]) -> None:
        fold, found = snaps[key]
        rho_max = 1.02 * max(rod.rho for rod in found.equilibrium.rods)
        members = solve_forward(fold.mechanism, fold.inputs, fold.load, rho_max)
        same = [member for member in members if np.abs(member.state - found.equilibrium.state).max() < 1e-8]
        assert len(same) == 1

    @pytest.mark.parametrize("key", FOLDS)
    def test_does_not_depend_on_how_closely_the_motion_is_followed(
        self, key: str, snaps: dict[str, tuple[Equilibrium, Snap]]
    ) -> None:
        fold, found = snaps[key]
        for rules, nodes in ((RelaxationRules(angle_error=0.01, steps=2000), 20), (RelaxationRules(), 32)):
            state, status, _ = relaxed_from(fold, rules, nodes)
            assert status == LANDED
            np.testing.assert_allclose(state, found.equilibrium.state, atol=1e-8)

    def test_is_the_same_every_time(self, snaps: dict[str, tuple[Equilibrium, Snap]]) -> None:
        for fold, found in snaps.values():
            again = snap(fold)
            assert np.array_equal(again.equilibrium.state, found.equilibrium.state)
            assert np.array_equal(again.energies, found.energies)

    def test_is_the_same_from_a_hair_before_the_fold(self, snaps: dict[str, tuple[Equilibrium, Snap]]) -> None:
        """The tracker ends at the last state before a fold, as near as rounding lets it."""
        home = home_by_construction("3PFR")
        fold, found = snaps["3PFR"]
        for gap in (1e-9, 1e-7):
            inputs = fold.inputs + gap * (home.inputs - fold.inputs)
            before = BranchTracker(home.mechanism, home).step(inputs).equilibrium
            np.testing.assert_allclose(snap(before).equilibrium.state, found.equilibrium.state, atol=1e-4)


def relaxed_from(start: Equilibrium, rules: RelaxationRules, nodes: int) -> tuple[np.ndarray, int, int]:
    mechanism, units = start.mechanism, start.mechanism.units
    point = Point(np.array(start.state), start.inputs / units.inputs, start.load / units.load)
    status, steps, _ = relax(
        mechanism.leg_table,
        point,
        rules,
        make_moving_rods(make_grid(nodes), mechanism.leg_count, mechanism.state_size, rules.steps),
        make_workspace(mechanism.leg_count, mechanism.state_size),
    )
    return point.x, status, steps


class TestUnstableEquilibria:
    @pytest.mark.parametrize("family", ["2RFR", "2PFR"])
    def test_fall_to_stable_members_of_the_forward_set(self, family: str) -> None:
        """Of every index, rods that are unstable between their ends among them: there the stiffness is positive."""
        rng = np.random.default_rng(3)
        inner = 0
        for _ in range(4):
            mechanism = random_mechanism(family, rng)
            members = solve_forward(mechanism, random_inputs(mechanism, rng), random_load(mechanism, rng))
            for start in (member for member in members if not member.is_stable):
                inner += start.stability_margin > 0.0
                found = snap(start)
                assert found.is_landed, start
                assert found.energy_released > 0.0
                assert (
                    any(
                        np.abs(member.state - found.equilibrium.state).max() < 1e-7
                        for member in members.stable
                        if member.energy < start.energy
                    )
                    or max(rod.rho for rod in found.equilibrium.rods) > 9.0
                )
        assert inner >= 2

    def test_of_platforms_fall(self) -> None:
        rng = np.random.default_rng(2)
        mechanism = random_mechanism("3PFR", rng)
        equilibria = find_equilibria(mechanism, random_inputs(mechanism, rng), np.zeros(3), rng, 2000, 6.5)
        unstable = [found for found in equilibria if not found.is_stable]
        assert len(unstable) >= 5
        assert all(snap(start).is_landed for start in unstable)


class TestPitchfork:
    """The 2PFR pressed down in its plane of symmetry: it may fall to either side."""

    @staticmethod
    def fork(target: float) -> Equilibrium:
        """Return the state at which tracking to this downward load, in EI / L^2, stops just before the pitchfork."""
        home = home_by_construction("2PFR")
        step = BranchTracker(home.mechanism, home).step(
            home.inputs, np.array([0.0, target]) * home.mechanism.units.load
        )
        assert step.event == Event.INDEX_CHANGE
        return step.equilibrium

    def test_falls_to_the_same_side_every_time(self) -> None:
        """Whatever rounding has left of the symmetry at the states where tracking stops."""
        landings = [snap(self.fork(target)).equilibrium for target in (-31.35, -32.0, -40.0, -100.0)]
        assert all(landing.is_stable for landing in landings)
        assert abs(landings[0].pose[0]) > 0.1
        for landing in landings:
            np.testing.assert_allclose(landing.pose, landings[0].pose, atol=1e-4)

    def test_a_hair_of_load_to_a_side_decides_otherwise(self) -> None:
        """Then it is a fold; both sides are there, and are mirror images."""
        home = home_by_construction("2PFR")
        landings = []
        for side in (-0.01, 0.01):
            load = np.array([side, -40.0]) * home.mechanism.units.load
            step = BranchTracker(home.mechanism, home).step(home.inputs, load)
            assert step.event == Event.FOLD
            landings.append(snap(step.equilibrium).equilibrium.pose)
        np.testing.assert_allclose(landings[0] * [-1.0, 1.0], landings[1], atol=1e-6)
        assert landings[0][0] < -0.1

    def test_beyond_it_the_unstable_branch_falls_to_the_same_side(self) -> None:
        home = home_by_construction("2PFR")
        load = np.array([0.0, -32.0]) * home.mechanism.units.load
        beyond = BranchTracker(home.mechanism, home, follow_index_changes=True).step(home.inputs, load).equilibrium
        assert beyond.index == 1
        landing = snap(beyond).equilibrium
        assert abs(landing.pose[0]) > 0.1
        assert np.sign(landing.pose[0]) == np.sign(snap(self.fork(-32.0)).equilibrium.pose[0])


class TestWithoutLanding:
    def test_a_moment_may_turn_a_platform_for_ever(self) -> None:
        """A small platform on soft rods gives way to a moment: each turn lowers the energy."""
        directions = np.radians([90.0, 210.0, 330.0])
        outwards = np.column_stack([np.cos(directions), np.sin(directions)])
        legs = tuple(
            Leg(Prismatic(tuple(0.6 * out), turn + math.pi / 2.0, turn + math.pi + 0.5), Rod(), tuple(0.15 * out))
            for out, turn in zip(outwards, directions, strict=True)
        )
        mechanism, rng = Mechanism("soft", legs), np.random.default_rng(0)
        load = np.array([0.0, 0.0, 8.0])
        equilibria = find_equilibria(mechanism, np.zeros(3), load, rng, 1500, 6.5)
        start = next(found for found in equilibria if not found.is_stable)
        found = snap(start)
        assert found.status == SnapStatus.NOT_SETTLED
        assert not found.is_landed
        assert found.equilibrium is start
        assert found.energy_released == 0.0
        assert found.energies[-1] < found.energies[0] - 3.0 * 2.0 * math.pi * load[2]

    def test_every_status_has_a_message(self) -> None:
        assert len({status.message for status in SnapStatus}) == len(SnapStatus)


class TestMisuse:
    @pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
    def test_a_stable_equilibrium_cannot_snap(self, name: str) -> None:
        with pytest.raises(ValueError, match="equilibrium must be unstable or at a fold to snap, got a stable one"):
            snap(home_by_construction(name))

    def test_no_equilibrium_cannot_snap(self) -> None:
        home = home_by_construction("2RFR")
        moved = Equilibrium(home.mechanism, home.state + 0.1, home.inputs, home.load)
        with pytest.raises(ValueError, match="equilibrium must be one, got a state with residual"):
            snap(moved)


class TestGrid:
    """The calculus on the nodes against a function whose integral and slope are known."""

    def test_converges_exponentially(self) -> None:
        errors = []
        for count in (8, 16):
            grid = make_grid(count)
            value, slope = np.sin(5.0 * grid.nodes), 5.0 * np.cos(5.0 * grid.nodes)
            bending = 0.5 * 25.0 * (1.0 + math.sin(10.0) / 10.0)
            errors.append(
                [
                    np.abs(grid.integral @ slope - value).max(),
                    abs(value @ grid.bending @ value - bending),
                    abs(grid.end @ value - math.sin(5.0)),
                    abs(slope @ grid.drag @ slope - grid.weights @ value**2),
                ]
            )
        assert (np.array(errors[1]) < 1e-9).all()
        assert (np.array(errors[0]) > 1e-7).any()


class TestChains:
    """The judge judged."""

    def test_energy_never_rises(self) -> None:
        fold, inputs_rate, load_rate = fold_on_the_way(*FOLDS["2RFR"])
        chains = Chains(fold.mechanism, fold.inputs + 0.01 * inputs_rate, fold.load + 0.01 * load_rate, 24)
        rest = chains.settle(chains.start(fold))
        energies = rest.energies[rest.times > 20.0 / CLOSING_RATE]  # closed
        assert len(energies) > 50
        # at rest it wavers by the integrator's tolerance, 1e-4 in the angles
        assert (np.diff(energies) < 1e-5 * np.ptp(energies)).all()

    def test_equilibria_converge_with_the_square_of_the_links(self) -> None:
        home = home_by_construction("2RFR")
        counts, errors = np.array([12, 24, 48]), []
        for links in counts:
            chains = Chains(home.mechanism, home.inputs, home.load, int(links))
            errors.append(np.linalg.norm(chains.settle(chains.start(home)).pose - home.pose))
        assert fitted_order(1.0 / counts, np.array(errors)) == pytest.approx(2.0, abs=0.2)
