"""Could a mechanism be built, and is it worth controlling? What its home sheets are, measured.

The home sheets are what stable ways from home reach within the actuators' limits, as the tasks chart it. Rods must not
yield there, nor cross what they must not: themselves, and on a platform each other and its edges. It is worth
controlling where random ways meet folds, and where the home sheets cover the same inputs more than once, so that
heading straight for a goal leads to the wrong equilibrium.
"""

import math
from dataclasses import dataclass

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.random import Generator

from agents.evaluation.rollouts import run_episodes
from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.settings import Settings
from pcm_gym.kernels.charts.roadmap import move_rows
from pcm_gym.kernels.snaps.instability import TERMINATE
from pcm_gym.kernels.statics.states import States, are_same
from pcm_gym.kernels.structure.contact import set_contacts
from pcm_gym.kernels.structure.strength import set_strengths
from pcm_gym.mechanism import Mechanism
from pcm_gym.references import new_reference
from pcm_gym.solving import Equilibrium, Roadmap
from pcm_gym.tasks.scene import Scene

# Steps of an agent in an episode of Reach, as registered, and episodes side by side.
_TIME_LIMIT, _ROWS = 100, 128
# Steps of an agent between two looks at a mechanism on a random move.
_STEPS_BETWEEN = 2.0


@dataclass(frozen=True)
class Strength:
    """What rods bear in some states: largest stress over yield stress, and whether one crosses what it must not."""

    stress: Array  # (n,)
    has_contact: Mask  # (n,)

    @classmethod
    def of(cls, mechanism: Mechanism, x: Array, inputs: Array) -> "Strength":
        """Return it for states (n, size) at inputs (n, legs), both dimensionless."""
        curvatures, forces = np.empty(inputs.shape), np.empty(inputs.shape)
        has_contact = np.zeros(len(x), dtype=np.bool_)
        set_strengths(mechanism.leg_table, x, inputs, curvatures, forces)
        set_contacts(mechanism.leg_table, x, inputs, has_contact)
        yielding = np.array([leg.rod.yield_curvature for leg in mechanism.legs]) * mechanism.units.length
        return cls((curvatures / yielding).max(axis=1), has_contact)


@dataclass(frozen=True)
class HomeSheets:
    """All that stable ways from home reach, node by node of the tasks' roadmap.

    Attributes
    ----------
    scene : Scene
    strength : Strength
        Of the nodes of its roadmap.
    """

    scene: Scene
    strength: Strength

    @classmethod
    def of(cls, mechanism: Mechanism) -> "HomeSheets":
        """Chart the home sheets of a mechanism without a load."""
        scene = Settings.from_arguments(mechanism, {}).scenes()[0]
        nodes = scene.at_nodes(np.arange(len(scene.roadmap)))
        return cls(scene, Strength.of(mechanism, nodes.x, nodes.inputs))

    @property
    def home(self) -> Equilibrium:
        """The home equilibrium."""
        return self.scene.home

    @property
    def roadmap(self) -> Roadmap:
        """What the tasks draw from."""
        return self.scene.roadmap

    @property
    def layers(self) -> Integers:
        """Number of nodes in each cell of the inputs, (cells,)."""
        return np.bincount(self.roadmap.cells, minlength=self.roadmap.raster.size)

    @property
    def covered(self) -> float:
        """Share of the inputs within the limits that the home sheets cover."""
        return float(np.mean(self.layers > 0))

    @property
    def covered_again(self) -> float:
        """Share of these that they cover more than once."""
        return float(np.mean(self.layers[self.layers > 0] > 1))

    @property
    def poses(self) -> Array:
        """Poses of the nodes, (n, d), in m and rad."""
        mechanism = self.roadmap.mechanism
        return mechanism.units.pose_from_kernel(self.roadmap.states[:, 2 * mechanism.leg_count :])

    @property
    def span(self) -> Array:
        """Extent of the poses along each coordinate, (d,), in m and rad."""
        span: Array = np.ptp(self.poses, axis=0)
        return span

    def at_home(self, count: int) -> States:
        """Return home so many times."""
        return self.scene.at_equilibrium(self.home, count)

    def starts(self, count: int, generator: Generator) -> States:
        """Return so many random states of the home sheets, drawn as tasks draw their starts."""
        return self.scene.starts(generator.random((count, 1 + self.roadmap.mechanism.leg_count)))

    def has_node_at(self, x: Array, inputs: Array) -> Mask:
        """Return which states (n, size) at inputs (n, legs), both dimensionless, lead to a node of their cell."""
        mechanism, roadmap = self.roadmap.mechanism, self.roadmap
        cells = roadmap.raster.cells_of(mechanism.units.inputs_from_kernel(inputs))
        first = np.searchsorted(cells_sorted := np.sort(roadmap.cells), cells)
        order, last = np.argsort(roadmap.cells, kind="stable"), np.searchsorted(cells_sorted, cells, side="right")
        states = self.scene.states(x, inputs)
        # the middle of a cell without a node is nowhere to go to
        middles = mechanism.units.kernel_from_inputs(roadmap.inputs[order[np.minimum(first, len(order) - 1)]])
        move_rows(mechanism.leg_table, states, np.where((last > first)[:, None], middles, inputs), TERMINATE)
        legs = mechanism.leg_count
        return np.array(
            [
                any(are_same(states.x[n], roadmap.states[node], legs) for node in order[first[n] : last[n]])
                for n in range(len(x))
            ]
        )


@dataclass(frozen=True)
class Moves:
    """What random straight moves met, to inputs that are anywhere within the limits.

    Attributes
    ----------
    count : int
    lost : float
        Share that loses stability.
    given_up : float
        Share that ends elsewhere: where rods are drawn straight, beyond what they can reach.
    greatest_stress : float
        Over the yield stress, in any state that was looked at: every other step of an agent.
    contacts : int
        Moves with a forbidden crossing in any of these states but a fold.
    contacts_at_folds : int
        Moves with one at the fold where they lose stability.
    on_roadmap : float
        Of the moves that arrive, the share that ends on the roadmap.
    """

    count: int
    lost: float
    given_up: float
    greatest_stress: float
    contacts: int
    contacts_at_folds: int
    on_roadmap: float


def random_moves(sheets: HomeSheets, states: States, generator: Generator) -> Moves:
    """Make a random straight move from each of some states of the home sheets, (n, ...), in place."""
    mechanism, steps, count = sheets.roadmap.mechanism, sheets.roadmap.raster.pitch, len(states.x)
    lower, upper = mechanism.lower_limits, mechanism.upper_limits
    targets = generator.uniform(lower, upper, (count, mechanism.leg_count))
    parts = math.ceil(float(((upper - lower) / steps).max()) / _STEPS_BETWEEN)
    goals, start = mechanism.units.kernel_from_inputs(targets), states.inputs.copy()
    goes_on, was_lost = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    stress, has_contact, folds_in_contact = np.zeros(count), np.zeros(count, dtype=np.bool_), 0
    for part in range(1, parts + 1):
        rows = np.flatnonzero(goes_on)
        own = States(*(array[rows] for array in states))
        arrived, lost = move_rows(
            mechanism.leg_table, own, start[rows] + part / parts * (goals[rows] - start[rows]), TERMINATE
        )
        for array, values in zip(states, own, strict=True):
            array[rows] = values
        strength = Strength.of(mechanism, own.x, own.inputs)
        stress[rows] = np.maximum(stress[rows], strength.stress)
        has_contact[rows] |= strength.has_contact & ~lost
        folds_in_contact += int((strength.has_contact & lost).sum())
        goes_on[rows], was_lost[rows] = arrived, lost
    ends = np.flatnonzero(goes_on)
    return Moves(
        count,
        float(was_lost.mean()),
        float((~goes_on & ~was_lost).mean()),
        float(stress.max()),
        int(has_contact.sum()),
        folds_in_contact,
        float(sheets.has_node_at(states.x[ends], states.inputs[ends]).mean()),
    )


@dataclass(frozen=True)
class Episodes:
    """What a reference came to in Reach, with goals anywhere.

    Attributes
    ----------
    count : int
    safe : float
        Share that ends at the goal, without any cost.
    lost : float
        Share that loses stability.
    """

    count: int
    safe: float
    lost: float


def reach_anywhere(mechanism: Mechanism, reference: str, count: int) -> Episodes:
    """Run episodes of Reach, goals anywhere, with a reference."""
    env = MechanismVectorEnv(
        min(count, _ROWS),
        mechanism=mechanism,
        difficulty="anywhere",
        max_episode_steps=_TIME_LIMIT,
        autoreset_mode=AutoresetMode.DISABLED,
    )
    results = list(run_episodes(env, reference, new_reference(reference), range(count)))
    env.close()
    safe, lost = ([getattr(result, name) for result in results] for name in ("is_safe_success", "is_violation"))
    return Episodes(count, float(np.mean(safe)), float(np.mean(lost)))


@dataclass(frozen=True)
class Evidence:
    """All of it for one mechanism.

    Attributes
    ----------
    sheets : HomeSheets
    moves, ways : Moves
        From home, and from random states of the home sheets.
    random, resolved_rate : Episodes
    """

    sheets: HomeSheets
    moves: Moves
    ways: Moves
    random: Episodes
    resolved_rate: Episodes

    @classmethod
    def of(cls, mechanism: Mechanism, moves: int, episodes: int, seed: int = 0) -> "Evidence":
        """Gather it: from so many random moves of each kind, and episodes of each of the two references."""
        sheets, generator = HomeSheets.of(mechanism), np.random.default_rng(seed)
        return cls(
            sheets,
            random_moves(sheets, sheets.at_home(moves), generator),
            random_moves(sheets, sheets.starts(moves, generator), generator),
            reach_anywhere(mechanism, "random", episodes),
            reach_anywhere(mechanism, "resolved rate", episodes),
        )

    @property
    def failings(self) -> tuple[str, ...]:
        """What is asked of a catalogued mechanism and does not hold, in words; empty where all does."""
        sheets, lost, safe = self.sheets, self.moves.lost, self.resolved_rate.safe
        everywhere = self.moves, self.ways
        stress = max(float(sheets.strength.stress.max()), *(own.greatest_stress for own in everywhere))
        has_contact = bool(sheets.strength.has_contact.any()) or any(own.contacts > 0 for own in everywhere)
        demands = {
            "a rod yields": stress >= 1.0,
            "a rod crosses what it must not": has_contact,
            "a rod is drawn straight": any(own.given_up > 0.0 for own in everywhere),
            f"{lost:.1%} of the random moves lose stability, not 10 to 40 %": not 0.1 <= lost <= 0.4,
            "no inputs are covered twice": sheets.covered_again == 0.0,
            f"the damped Jacobian succeeds in {safe:.1%}, more than 60 %": safe > 0.6,
            f"random actions succeed in {self.random.safe:.1%}, more than 5 %": self.random.safe > 0.05,
            "the workspace spans less than half a rod": bool((sheets.span[:2] < 0.5 * _rod_length(sheets)).any()),
        }
        return tuple(words for words, fails in demands.items() if fails)


def _rod_length(sheets: HomeSheets) -> float:
    return float(np.mean([leg.rod.length for leg in sheets.roadmap.mechanism.legs]))
