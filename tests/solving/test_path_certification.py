"""Proofs along paths: random walks are proved, wrong ones never; folds are found where others found them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import (
    BranchTracker,
    Equilibrium,
    EquilibriumSet,
    Event,
    build_roadmap,
    certify_path,
    home_equilibrium,
    nearest_fold,
    path_certification,
    solve_forward,
)
from tests.reference.mechanisms import FAMILIES
from tests.reference.paths import MUTATIONS, mutated, random_starts, random_walks


def home(name: str) -> Equilibrium:
    return home_equilibrium(get_mechanism(f"{name}-paper"))


def nearest(found: EquilibriumSet, pose: tuple[float, ...]) -> Equilibrium:
    return min(found, key=lambda e: math.dist(e.pose, pose))


def motors(half: float, load: tuple[float, float], inputs: tuple[float, float]) -> EquilibriumSet:
    """Return the equilibria of two motors near each other."""
    mechanism = Mechanism("motors", tuple(Leg(Revolute((x, 0.0)), Rod(1.0, 1.0)) for x in (-half, half)))
    return solve_forward(mechanism, inputs, load, rho_max=12.0)


class TestRandomWalks:
    """Five steps of an agent in random directions, from stable and unstable equilibria."""

    @pytest.mark.parametrize("family", FAMILIES)
    def test_walks_without_an_event_are_proved(self, family: str) -> None:
        walks = [walk for walk in random_walks(family, 25, np.random.default_rng(0)) if walk.event == Event.NONE]
        proofs = [certify_path(walk.equilibria[0].mechanism, walk.equilibria) for walk in walks]
        assert np.mean([proof.is_proved for proof in proofs]) >= 0.95
        assert {walk.equilibria[0].index for walk in walks} >= {0, 1}
        for walk, proof in zip(walks, proofs, strict=True):
            assert not proof.is_proved or {e.index for e in walk.equilibria} == {proof.index}
            assert not proof.is_proved or proof.error < 1e-5

    @pytest.mark.parametrize("family", FAMILIES)
    def test_wrong_paths_are_never_proved(self, family: str) -> None:
        rng = np.random.default_rng(1)
        wanted = dict.fromkeys(MUTATIONS, 4)
        for walk in random_walks(family, 200, rng):
            for kind in (kind for kind, count in wanted.items() if count > 0):
                path = mutated(walk, kind, rng)
                if path is not None:
                    wanted[kind] -= 1
                    assert not certify_path(path[0].mechanism, path).is_proved, kind
            if not any(wanted.values()):
                break
        assert not any(wanted.values())

    @pytest.mark.parametrize("family", FAMILIES)
    def test_a_wrong_state_is_named_with_its_place(self, family: str) -> None:
        rng = np.random.default_rng(2)
        walk = next(walk for walk in random_walks(family, 50, rng) if walk.event == Event.NONE)
        for kind, line, fraction in (("start", 0, 0.0), ("turn", 1, 1.0), ("target", 4, 1.0)):
            path = mutated(walk, kind, rng)
            assert path is not None
            proof = certify_path(path[0].mechanism, path)
            assert (proof.status, proof.reason) == ("undecided", "state")
            assert (proof.line, proof.fraction) == (line if kind != "turn" else len(path) // 2 - 1, fraction)

    def test_errors_of_states_are_bounded(self) -> None:
        """A state polished in multiple steps and one that is wrong by 1e-10: the bound holds the difference."""
        start = home("2RFR")
        end = BranchTracker(start.mechanism, start).step(start.inputs + 0.05).equilibrium
        wrong = Equilibrium(end.mechanism, end.state * (1.0 + 3e-10), end.inputs, end.load)
        gap = np.max(np.abs(wrong.state - end.state) / (1.0 + np.abs(end.state)))
        proof = certify_path(start.mechanism, [start, wrong])
        assert gap <= proof.error < 1e-7


class TestFolds:
    @pytest.mark.parametrize("family", FAMILIES)
    def test_steps_that_end_at_folds_are_proved_up_to_them(self, family: str) -> None:
        rng = np.random.default_rng(3)
        starts = random_starts(get_mechanism(f"{family}-paper"), rng)
        folds = 0
        while folds < 5:
            start = next(starts)
            direction = rng.normal(size=start.mechanism.leg_count)
            step = BranchTracker(start.mechanism, start, certify=True).step(start.inputs + 0.2 * direction)
            if step.event != Event.FOLD:
                continue
            folds += 1
            proof = step.certificate
            assert proof is not None
            assert (proof.status, proof.reason) == ("undecided", "singular")
            assert step.fraction - 1e-2 < proof.fraction < step.fraction

    def test_beyond_a_fold_no_equilibrium_is_proved_and_the_fold_is_where_newton_steps_put_it(self) -> None:
        """A motor and a slider without any symmetry; 20,000 plain Newton steps put the fold at 0.7444 of the way."""
        legs = (
            Leg(
                Revolute((-0.2331371432711577, -0.08678963751770925), 0.20687548015474727),
                Rod(1.0607339725492895, 0.5920857005617851),
            ),
            Leg(
                Prismatic((0.2331371432711577, 0.005340698338201971), 1.6259502848068998, 2.3641271602783798),
                Rod(0.991790722121595, 0.7849185877151437),
            ),
        )
        mechanism, load = Mechanism("motor and slider", legs), (0.7443967137046243, 4.446921280981519)
        found = solve_forward(mechanism, (-2.8855562922210534, -0.2591618500770084), load, rho_max=12.0)
        start = nearest(found, (0.11262313, 0.41758626))
        assert start.is_stable
        goals = solve_forward(mechanism, (-3.023193622547879, -0.0858506768532063), load, rho_max=12.0)
        assert len(goals) >= 2
        for goal in goals:
            proof = certify_path(mechanism, [start, goal])
            assert not proof.is_proved
            assert proof.fraction == pytest.approx(0.7444, abs=1e-3)

    def test_a_window_of_another_index_is_not_stepped_over(self) -> None:
        """Two motors 0.1 apart under a load downwards: between a = -0.17 and -0.47 the index is 1."""

        def upright(a: float) -> Equilibrium:
            inputs = (math.pi / 2.0 + a, math.pi / 2.0 - a)
            found = motors(0.05, (0.0, -8.0), inputs)
            return min((e for e in found if abs(e.pose[0]) < 1e-6), key=lambda e: (e.index, -e.pose[1]))

        start, end = upright(0.1), upright(-0.7)
        assert start.index == end.index == 0
        proof = certify_path(start.mechanism, [start, end])
        assert not proof.is_proved
        assert 0.1 - 0.8 * proof.fraction == pytest.approx(-0.17, abs=0.01)

    def test_the_mirror_branch_is_not_taken_for_the_own_one(self) -> None:
        """A step of 0.08 rad under a large load upwards: the branch and its mirror image are 6 cm apart."""
        found = motors(0.05, (0.0, 15.0), (1.45160796, 1.69002651))
        goals = motors(0.05, (0.0, 15.0), (1.50518584, 1.63644863))
        for start in found:
            proved = [goal for goal in goals if certify_path(start.mechanism, [start, goal]).is_proved]
            assert len(proved) <= 1
            for goal in proved:
                tracker, way = BranchTracker(start.mechanism, start), goal.inputs - start.inputs
                for n in range(1, 65):
                    step = tracker.step(start.inputs + way * (n / 64.0))
                    assert step.event == Event.NONE
                np.testing.assert_allclose(step.equilibrium.state, goal.state, atol=1e-6)

    def test_up_to_the_nearest_fold_all_is_proved(self) -> None:
        start = home("2RFR")
        fold = nearest_fold(start)
        assert fold is not None
        way = fold.inputs - start.inputs
        step = BranchTracker(start.mechanism, start, certify=True).step(start.inputs + 0.999 * way)
        assert step.certificate is not None
        assert step.certificate.is_proved

    @pytest.mark.parametrize("family", FAMILIES)
    def test_a_path_that_begins_at_a_fold_or_at_no_equilibrium_says_which(self, family: str) -> None:
        rng = np.random.default_rng(6)
        walk = next(walk for walk in random_walks(family, 200, rng) if walk.event == Event.FOLD)
        before, fold = walk.equilibria[-2:]
        assert certify_path(fold.mechanism, [fold, before]).reason == "singular"
        no_equilibrium = Equilibrium(before.mechanism, before.state + 5.0, before.inputs, before.load)
        proof = certify_path(before.mechanism, [no_equilibrium, before])
        assert (proof.reason, proof.line, proof.fraction) == ("state", 0, 0.0)


class TestSpecialStates:
    @pytest.mark.parametrize("force", [0.0, 3.0])
    def test_straight_rods(self, force: float) -> None:
        """Unloaded or in pure tension on the way: where the rods' own stiffness has a pole."""
        straight = math.acos(0.35)
        mechanism = Mechanism("motors", tuple(Leg(Revolute((x, 0.0)), Rod(1.0, 1.0)) for x in (-0.35, 0.35)))
        path = []
        for angle in (straight - 0.02, straight, straight + 0.02):
            found = solve_forward(mechanism, [angle, math.pi - angle], (0.0, force))
            path.append(min(found, key=lambda e: math.dist(e.pose, (0.0, math.sin(straight)))))
        assert certify_path(mechanism, path).is_proved
        assert certify_path(mechanism, [path[0], path[2]]).is_proved

    def test_loads_may_change_and_inputs_may_stay(self) -> None:
        start = home("3PFR")
        load = 2.0 * start.mechanism.units.load * [1.0, -1.0, 0.5]
        step = BranchTracker(start.mechanism, start, certify=True).step(start.inputs, load)
        assert step.certificate is not None
        assert step.certificate.is_proved
        assert certify_path(start.mechanism, [start, start]).is_proved

    def test_a_platform_that_has_turned_once_around_is_the_same(self) -> None:
        start = home("3PFR")
        step = BranchTracker(start.mechanism, start).step(start.inputs + 0.01)
        state = step.equilibrium.state + 2.0 * math.pi * (np.arange(9) == 8)
        turned = Equilibrium(start.mechanism, state, step.equilibrium.inputs, start.load)
        assert certify_path(start.mechanism, [start, turned]).is_proved


class TestInterface:
    def test_ways_of_a_roadmap_are_proved(self) -> None:
        roadmap = build_roadmap(get_mechanism("2RFR-paper"), [home("2RFR")])
        nodes = roadmap.way(0, int(np.flatnonzero(roadmap.components == roadmap.components[0])[-1]))
        assert len(nodes) > 3
        proof = certify_path(roadmap.mechanism, [roadmap.equilibrium(int(node)) for node in nodes])
        assert proof.is_proved
        assert proof.index == 0
        assert proof.line == len(nodes) - 2
        assert repr(proof) == f"PathCertificate: proved, index 0, {proof.tubes} tubes"

    def test_no_certificate_unless_asked_for(self) -> None:
        start = home("2RFR")
        assert BranchTracker(start.mechanism, start).step(start.inputs + 0.01).certificate is None

    def test_a_broken_off_search_says_so(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(path_certification, "_MOST_PIECES", 2)
        monkeypatch.setattr(path_certification, "_PIECES_AT_ONCE", 1)
        start = home("2RFR")
        end = BranchTracker(start.mechanism, start).step(start.inputs + np.array([0.4, -0.4])).equilibrium
        proof = certify_path(start.mechanism, [start, end])
        assert proof.reason == "limit"
        assert "the search was broken off" in repr(proof)

    def test_the_search_may_be_broken_off_and_go_on_anywhere(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Pieces tried one by one, and all at once: the same proof."""
        walk = next(walk for walk in random_walks("2PFR", 50, np.random.default_rng(5)) if walk.event == Event.NONE)
        mechanism = walk.equilibria[0].mechanism
        whole = certify_path(mechanism, walk.equilibria)
        monkeypatch.setattr(path_certification, "_PIECES_AT_ONCE", 1)
        assert certify_path(mechanism, walk.equilibria) == whole
        assert replace(whole, fraction=0.5) != whole

    def test_what_is_no_path_is_refused(self) -> None:
        start, other = home("2RFR"), home("2PFR")
        with pytest.raises(ValueError, match="equilibria must be at least two, got 1"):
            certify_path(start.mechanism, [start])
        with pytest.raises(
            ValueError, match="equilibria must belong to the mechanism '2RFR-paper', got one of '2PFR-paper' in place 1"
        ):
            certify_path(start.mechanism, [start, other])
        with pytest.raises(TypeError, match="equilibria must be a sequence of Equilibrium, got 3 in it"):
            certify_path(start.mechanism, [start, 3])  # type: ignore[list-item]
