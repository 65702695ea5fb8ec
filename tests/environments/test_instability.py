"""What environments do where stability is lost: against replays on branches, forward sets and a discrete energy."""

import math
import pickle
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

import pcm_gym
from pcm_gym import BranchTracker, Equilibrium, Event
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.solving import snap, solve_forward
from pcm_gym.tasks.task import OnInstability
from tests.environments.rollouts import (
    assert_same,
    make_bare,
    make_native,
    roll_batch,
    roll_single,
    sweeping_actions,
)
from tests.reference.discrete_energy import DiscreteEnergy
from tests.reference.mechanisms import find_equilibria

IDS = [name for name in pcm_gym.environment_ids() if "-Reach-" in name]  # the tasks have no part in it
BEHAVIOURS: tuple[OnInstability, ...] = ("terminate", "hold", "snap", "continue")
LOSSES = (Event.FOLD, Event.INDEX_CHANGE)
MANY = 300  # rows that threads share


class Met(NamedTuple):
    """A step on whose way stability is lost."""

    before: Equilibrium
    target: np.ndarray
    observation: dict[str, np.ndarray]
    terminated: bool
    truncated: bool
    info: dict[str, Any]
    after: Equilibrium


def is_stable_in(env: MechanismEnv, observation: dict[str, np.ndarray]) -> bool:
    value = observation["observation"][[element.name for element in env.elements].index("is_stable")]
    assert value in (0.0, 1.0)
    return bool(value)


def met_by(env: MechanismEnv, seeds: range, steps: int = 60) -> Iterator[Met]:
    """Walks from reset in one direction each, and yields the steps that meet an event, in each episode the first."""
    for seed in seeds:
        env.reset(seed=seed)
        action = np.random.default_rng(seed).choice([-1.0, 1.0], env.action_space.shape)
        for _ in range(steps):
            before = env.equilibrium
            mechanism = env.mechanism
            target = np.clip(before.inputs + action * env.max_action, mechanism.lower_limits, mechanism.upper_limits)
            observation, _, terminated, truncated, info = env.step(action)
            if info["event"] in (*LOSSES, Event.SOLVER_FAILURE):
                yield Met(before, target, observation, terminated, truncated, info, env.equilibrium)
                break


def assert_member(members: Any, equilibrium: Equilibrium) -> None:
    distances = [np.abs(member.state - equilibrium.state).max() for member in members]
    assert min(distances) < 1e-7


@pytest.mark.parametrize("environment_id", IDS)
class TestEveryEnvironment:
    def test_hold_keeps_the_state_exactly(self, environment_id: str) -> None:
        env = make_bare(environment_id, on_instability="hold")
        count = 0
        for met in met_by(env, range(12)):
            count += 1
            assert met.info["event"] in LOSSES
            assert (met.terminated, met.truncated, met.info["cost_unstable"]) == (False, False, 1.0)
            assert met.after.state.tobytes() == met.before.state.tobytes()
            assert met.after.inputs.tobytes() == met.before.inputs.tobytes()
            assert is_stable_in(env, met.observation)
            assert met.info["index"] == met.after.index == 0
            # the way there does lose stability
            assert BranchTracker(env.mechanism, met.before).step(met.target).event == met.info["event"]
        assert count >= 3

    def test_a_refused_increment_leaves_no_trace(self, environment_id: str) -> None:
        env = make_bare(environment_id, on_instability="hold")
        for seed in range(12):
            env.reset(seed=seed)
            action = np.random.default_rng(seed).choice([-1.0, 1.0], env.action_space.shape)
            for _ in range(60):
                state = env.save_state()
                if env.step(action)[-1]["event"] in LOSSES:
                    after = [env.step(0.5 * action), env.step(-action)]
                    env.restore_state(state)
                    assert_same([env.step(0.5 * action), env.step(-action)], after)
                    return
        raise AssertionError("no event was met")

    def test_snap_falls_as_often_as_it_must_and_goes_on(self, environment_id: str) -> None:
        """The same by hand: follow the branch to the fold, fall, follow the next one to the target."""
        env = make_bare(environment_id, on_instability="snap")
        count = 0
        for met in met_by(env, range(12)):
            count += 1
            assert met.info["event"] in LOSSES
            assert (met.terminated, met.truncated, met.info["cost_unstable"]) == (False, False, 1.0)
            tracker, falls = BranchTracker(env.mechanism, met.before), 0
            while (step := tracker.step(met.target)).event in LOSSES:
                landing = snap(step.equilibrium)
                assert landing.is_landed
                assert landing.equilibrium.energy < step.equilibrium.energy
                tracker, falls = BranchTracker(env.mechanism, landing.equilibrium), falls + 1
            assert falls >= 1
            np.testing.assert_allclose(met.after.inputs, met.target, rtol=0.0, atol=1e-14)
            np.testing.assert_allclose(met.after.state, step.equilibrium.state, rtol=0.0, atol=1e-8)
            assert is_stable_in(env, met.observation)
            assert met.info["index"] == met.after.index == 0
            if count <= 2:
                rho_max = 1.02 * max(rod.rho for rod in met.after.rods)
                assert_member(solve_forward(env.mechanism, met.after.inputs, met.after.load, rho_max).stable, met.after)
            assert env.step(np.zeros(env.action_space.shape))[-1]["cost_unstable"] == 0.0
        assert count >= 3

    def test_continue_follows_unstable_equilibria(self, environment_id: str) -> None:
        """Index and pose after some steps against a discretised energy that knows nothing of the kernels."""
        env = make_bare(environment_id, on_instability="continue")
        env.reset(seed=0)
        home = pcm_gym.home_equilibrium(env.mechanism, env.equilibrium.load)
        members = find_equilibria(env.mechanism, home.inputs, home.load, np.random.default_rng(0), 3000, 6.5)
        unstable = [member for member in members if not member.is_stable]
        discrete, indices, folds = DiscreteEnergy(env.mechanism), set(), 0
        for seed, start in enumerate(unstable[:8]):
            observation, info = env.reset(seed=seed, options={"equilibrium": start})
            assert (info["index"], info["cost"], info["is_success"]) == (start.index, 0.0, False)
            assert not is_stable_in(env, observation)
            action = np.random.default_rng(seed).uniform(-1.0, 1.0, env.action_space.shape)
            for _ in range(6):
                observation, _, terminated, truncated, info = env.step(action)
                assert not truncated
                assert not is_stable_in(env, observation)
                assert info["cost_unstable"] == 1.0
                assert terminated == (info["event"] == Event.FOLD)
                if terminated:
                    folds += 1
                    break
            assert env.equilibrium.residual < 1e-10
            if not terminated:
                here = env.equilibrium
                z = discrete.solve(discrete.start(here), here.inputs, here.load)
                np.testing.assert_allclose(z[discrete.rods : discrete.free], here.pose, atol=1e-7)
                assert (discrete.eigenvalues(z, here.inputs, here.load) < 0.0).sum() == info["index"]
                indices.add(info["index"])
        assert max(indices) >= 1

    def test_continue_ends_at_folds_as_terminate_does(self, environment_id: str) -> None:
        """From stable starts nothing else can happen where no bifurcation is on the way."""
        for seed in range(4):
            records = [
                roll_single(make_bare(environment_id, on_instability=behaviour), seed, 60)
                for behaviour in ("terminate", "continue")
            ]
            assert_same(*records)

    @pytest.mark.parametrize("behaviour", BEHAVIOURS)
    def test_rows_of_a_batch_are_single_environments(self, environment_id: str, behaviour: str) -> None:
        """Bit for bit, in any batch, on any number of threads, however often they are asked."""
        keywords = {"on_instability": behaviour}
        batches = [
            make_native(environment_id, MANY, threads=threads, autoreset_mode="Disabled", **keywords)
            for threads in (1, 3)
        ]
        rows = (0, 1, 5, MANY - 1)
        singles = [make_bare(environment_id, **keywords) for _ in rows]
        actions = sweeping_actions(25, batches[0].action_space.shape, seed=0, hold=25)
        firsts = [batch.reset(seed=0) for batch in batches]
        for row, env in zip(rows, singles, strict=True):
            env.reset(seed=row)
        assert_same(*firsts)
        events = 0
        for action in actions:
            first, second = (batch.step(action) for batch in batches)
            assert_same(first, second)
            observation, _, terminated, truncated, infos = first
            for row, env in zip(rows, singles, strict=True):
                alone = env.step(action[row])
                assert alone[0]["observation"].tobytes() == observation["observation"][row].tobytes()
                assert alone[2:4] == (terminated[row], truncated[row])
                assert alone[4] == {key: infos[key][row] for key in alone[4]}
                if terminated[row] or truncated[row]:
                    env.reset()
            events += sum(event in LOSSES for event in infos["event"])
            if (ended := terminated | truncated).any():
                for batch in batches:
                    batch.reset(options={"reset_mask": ended})
        assert events > 10

    @pytest.mark.parametrize("behaviour", BEHAVIOURS)
    def test_equal_seeds_and_restored_states_go_on_alike(self, environment_id: str, behaviour: str) -> None:
        keywords = {"on_instability": behaviour}
        first, second = (make_bare(environment_id, **keywords) for _ in range(2))
        assert_same(roll_single(first, 3, 80), roll_single(second, 3, 80))
        state = pickle.dumps(first.save_state())
        rest = roll_on(first)
        first.restore_state(pickle.loads(state))
        assert_same(roll_on(first), rest)
        second.restore_state(pickle.loads(state))
        assert_same(roll_on(second), rest)

    def test_only_continue_takes_unstable_starts(self, environment_id: str) -> None:
        for behaviour in BEHAVIOURS[:3]:
            env = make_bare(environment_id, on_instability=behaviour)
            unstable = unstable_at_home(env.mechanism)
            with pytest.raises(ValueError, match="equilibrium must be stable"):
                env.reset(options={"equilibrium": unstable})
        batch = make_native(environment_id, 3, on_instability="continue")
        _, infos = batch.reset(seed=0, options={"equilibrium": unstable})
        assert infos["index"].tolist() == [unstable.index] * 3


def roll_on(env: Any) -> list[Any]:
    actions = sweeping_actions(25, env.action_space.shape, seed=8, hold=25)
    return [env.step(action) for action in actions]


def unstable_at_home(mechanism: Mechanism) -> Equilibrium:
    home = pcm_gym.home_equilibrium(mechanism)
    found = find_equilibria(mechanism, home.inputs, home.load, np.random.default_rng(0), 2000, 6.5)
    return next(member for member in found if not member.is_stable)


# Inputs of the first motor of the fork on both sides of its pitchfork; at 0.85 the two branches have become one again.
BEFORE, BEYOND = 0.15, 0.25


def mirrored(first: float) -> np.ndarray:
    """Inputs of both motors of the fork."""
    return np.array([first, math.pi - first])


@pytest.fixture(scope="module")
def fork() -> Equilibrium:
    """A symmetric mechanism under a load on its axis, before a bifurcation into two stable branches."""
    motors = (Revolute((x, 0.0), limits=(-6.0, 8.0)) for x in (-0.19, 0.19))
    mechanism = Mechanism(
        "fork", tuple(Leg(motor) for motor in motors), home_inputs=tuple(mirrored(-1.0)), home_pose=(0.0, 0.5)
    )
    home = pcm_gym.home_equilibrium(mechanism, (0.0, -6.4))
    return BranchTracker(mechanism, home).step(mirrored(BEFORE)).equilibrium


class TestPitchfork:
    """Motors that turn alike drive a symmetric mechanism out of one stable branch into two."""

    def stepped(self, fork: Equilibrium, behaviour: OnInstability, targets: list[float]) -> tuple[Any, list[Any]]:
        env: Any = MechanismEnv(fork.mechanism, on_instability=behaviour, max_action=1.0)
        here = BEFORE
        env.reset(seed=0, options={"equilibrium": fork, "goal": (0.0, 0.5)})
        records = []
        for target in targets:
            records.append(env.step(np.array([target - here, here - target])))
            here = target
        return env, records

    def test_is_supercritical(self, fork: Equilibrium) -> None:
        """Before it there is one stable equilibrium about the axis, beyond it one on each side."""
        for first, count in ((BEFORE, 1), (BEYOND, 2)):
            members = solve_forward(fork.mechanism, mirrored(first), fork.load)
            stable = [member for member in members.stable if member.pose[1] > 0.7]
            assert len(stable) == count
        with pytest.raises(ValueError, match="got a stable one"):
            snap(BranchTracker(fork.mechanism, fork).step(mirrored(BEYOND)).equilibrium)

    @pytest.mark.parametrize("beyond", [0.208, 0.21, BEYOND, 0.3])
    def test_snap_takes_one_of_the_stable_branches(self, fork: Equilibrium, beyond: float) -> None:
        env, [(observation, _, terminated, truncated, info)] = self.stepped(fork, "snap", [beyond])
        assert (info["event"], info["cost_unstable"], terminated, truncated) == (Event.INDEX_CHANGE, 1.0, False, False)
        assert (info["index"], is_stable_in(env, observation)) == (0, True)
        np.testing.assert_allclose(env.equilibrium.inputs, mirrored(beyond), atol=1e-14)
        assert env.equilibrium.pose[0] < -0.01
        assert_member(solve_forward(fork.mechanism, mirrored(beyond), fork.load).stable, env.equilibrium)

    def test_snap_stays_stable_however_little_beyond_the_target_is(self, fork: Equilibrium) -> None:
        """Where nothing can tell the branches apart it stops at the bifurcation, or the solver fails; it never lies."""
        point = BranchTracker(fork.mechanism, fork).step(mirrored(BEYOND)).equilibrium.inputs[0]
        for beyond in 10.0 ** np.arange(-9.0, -2.0):
            env, [(observation, _, terminated, truncated, info)] = self.stepped(fork, "snap", [point + beyond])
            assert not terminated
            assert truncated == (info["cost_solver"] == 1.0)
            assert (info["index"], is_stable_in(env, observation)) == (0, True)
            assert env.equilibrium.inputs[0] == pytest.approx(BEFORE if truncated else point + beyond, abs=1e-3)

    def test_continue_goes_through_both(self, fork: Equilibrium) -> None:
        env, records = self.stepped(fork, "continue", [BEYOND, 0.5, 0.9])
        infos = [record[-1] for record in records]
        assert [info["event"] for info in infos] == [Event.INDEX_CHANGE, Event.NONE, Event.INDEX_CHANGE]
        assert [info["index"] for info in infos] == [1, 1, 0]
        assert [info["cost_unstable"] for info in infos] == [1.0, 1.0, 1.0]
        assert [is_stable_in(env, record[0]) for record in records] == [False, False, True]
        assert not any(record[2] or record[3] for record in records)
        assert abs(env.equilibrium.pose[0]) < 1e-9
        tracker = BranchTracker(fork.mechanism, fork, follow_index_changes=True)
        np.testing.assert_allclose(env.equilibrium.pose, tracker.step(mirrored(0.9)).equilibrium.pose, atol=1e-9)

    def test_continue_tells_of_a_visit_to_instability_within_one_step(self, fork: Equilibrium) -> None:
        _, [(_, _, terminated, _, info)] = self.stepped(fork, "continue", [0.9])
        assert (info["event"], info["index"], info["cost_unstable"], terminated) == (Event.INDEX_CHANGE, 0, 1.0, False)

    def test_terminate_and_hold(self, fork: Equilibrium) -> None:
        env, [(observation, _, terminated, _, info)] = self.stepped(fork, "terminate", [BEYOND])
        assert (info["event"], info["cost_unstable"], terminated) == (Event.INDEX_CHANGE, 1.0, True)
        assert not is_stable_in(env, observation)
        env, [(observation, _, terminated, _, info)] = self.stepped(fork, "hold", [BEYOND])
        assert (info["event"], info["cost_unstable"], terminated) == (Event.INDEX_CHANGE, 1.0, False)
        assert is_stable_in(env, observation)
        assert env.equilibrium.state.tobytes() == fork.state.tobytes()


@pytest.fixture(scope="module")
def restless() -> Equilibrium:
    """A small platform on soft rods that gives way to a moment: beyond a fold it turns for ever."""
    directions = np.radians([90.0, 210.0, 330.0])
    outwards = np.column_stack([np.cos(directions), np.sin(directions)])
    legs = tuple(
        Leg(Prismatic(tuple(0.6 * out), turn + math.pi / 2.0, turn + math.pi + 0.5), Rod(), tuple(0.15 * out))
        for out, turn in zip(outwards, directions, strict=True)
    )
    mechanism = Mechanism("soft", legs)
    light, heavy = np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 5.0])
    members = find_equilibria(mechanism, np.zeros(3), light, np.random.default_rng(0), 1500, 6.5)
    start = next(member for member in members if member.is_stable)
    return BranchTracker(mechanism, start).step(start.inputs, heavy).equilibrium


def test_a_fall_without_a_landing_is_a_failure_of_the_solver_and_nothing_else(restless: Equilibrium) -> None:
    env: Any = MechanismEnv(restless.mechanism, on_instability="snap")
    held: Any = MechanismEnv(restless.mechanism, on_instability="hold")
    for one in (env, held):
        one.reset(seed=0, options={"equilibrium": restless, "goal": restless.pose})
    for _ in range(20):
        before = env.equilibrium
        observation, _, terminated, truncated, info = env.step(np.ones(3))
        other = held.step(np.ones(3))[-1]
        if truncated:
            break
    assert (terminated, truncated) == (False, True)
    assert (info["event"], info["cost_solver"], info["cost_unstable"]) == (Event.SOLVER_FAILURE, 1.0, 0.0)
    assert (info["index"], is_stable_in(env, observation)) == (0, True)
    assert env.equilibrium.state.tobytes() == before.state.tobytes()
    assert env.equilibrium.inputs.tobytes() == before.inputs.tobytes()
    # physically it is a fold, from which the fall does not end
    assert (other["event"], other["cost_unstable"]) == (Event.FOLD, 1.0)
    fold = BranchTracker(restless.mechanism, before).step(before.inputs + env.max_action)
    assert fold.event == Event.FOLD
    assert not snap(fold.equilibrium).is_landed


def test_standing_still_at_the_edge_of_stability_is_no_failure() -> None:
    env: Any = MechanismEnv("2RFR", on_instability="hold")
    home = pcm_gym.home_equilibrium(env.mechanism)
    fold = BranchTracker(env.mechanism, home).step([0.3, 6.0])
    assert fold.event == Event.FOLD
    env.reset(seed=0, options={"equilibrium": fold.equilibrium, "goal": home.pose})
    for _ in range(3):
        *_, truncated, info = env.step(np.zeros(2))
        assert (truncated, info["event"], info["cost_unstable"]) == (False, Event.NONE, 0.0)
    assert env.equilibrium.state.tobytes() == fold.equilibrium.state.tobytes()


def test_the_batch_takes_every_behaviour() -> None:
    for behaviour in BEHAVIOURS:
        env = MechanismVectorEnv(2, on_instability=behaviour)
        roll_batch(env, 0, 2)
