"""One browser's session: its mechanism, the state it has, and the answers to what it asks."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.explorer import messages
from pcm_gym.explorer.views import (
    Data,
    diagram_view,
    equilibrium_view,
    folds_view,
    json_text,
    mechanism_view,
    python_lines,
)
from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.mechanism.text import mechanism_from_json
from pcm_gym.plain import plain
from pcm_gym.rendering.vector import equilibrium_svg
from pcm_gym.solving import (
    BifurcationDiagram,
    BranchTracker,
    Equilibrium,
    Event,
    SingularCurve,
    bifurcation_diagram,
    forward_singularities,
    home_equilibrium,
    search_budget,
    snap,
    solve_forward,
)

RHO_MAX = 9.0
# What a search may spend, in tests: a few seconds.
_BUDGET = 2e7
# Of a drag: corrections, the longest change of an input in one of them, in rad and mean rod lengths, how near, in mean
# rod lengths, is there, and what damps corrections where no input moves the end-effector.
_CORRECTIONS, _LONGEST, _NEAR, _DAMPING = 4, 0.15, 1e-6, 1e-3
# Largest load of a diagram, in EI / L^2.
_LARGEST_LOAD = 20.0
_SAME = 1e-6
# Maps of folds that are kept, of all sessions.
_MAPS = 32


class Session:
    """What one browser does, apart from how its messages come and go.

    Parameters
    ----------
    mechanism : Mechanism
        Where it begins, at home.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._take(mechanism)

    @property
    def equilibrium(self) -> Equilibrium:
        """The present state."""
        return self._equilibrium

    def greeting(self) -> Data:
        """Return what a page is told first."""
        view = mechanism_view(self._mechanism)
        return {"kind": "mechanism", "mechanism": plain(view), "names": mechanism_names(), "state": self._state()}

    def answer(self, message: messages.Message) -> Data:
        """Return the answer to a message; of what cannot be done, the reason."""
        with search_budget(_BUDGET):
            try:
                content: Data = self._answers[type(message)](message)
            except (ArithmeticError, RuntimeError, TypeError, ValueError) as error:
                content = {"kind": "refused", "reason": str(error) or type(error).__name__}
        return content | {"answers": message.id}

    @property
    def _answers(self) -> dict[type[Any], Callable[[Any], Data]]:
        return {
            messages.Choose: self._choose,
            messages.Read: self._read,
            messages.Drive: lambda asked: self._move(inputs=asked.inputs),
            messages.Drag: self._drag,
            messages.Load: lambda asked: self._move(load=asked.load),
            messages.Pick: self._pick,
            messages.Release: lambda _: self._fall(),
            messages.Folds: self._folds,
            messages.Diagram: self._make_diagram,
            messages.Go: self._go,
            messages.Export: self._export,
        }

    def _choose(self, asked: messages.Choose) -> Data:
        self._take(get_mechanism(asked.name))
        return self.greeting()

    def _read(self, asked: messages.Read) -> Data:
        self._take(mechanism_from_json(asked.text))
        return self.greeting()

    def _take(self, mechanism: Mechanism) -> None:
        self._set(home_equilibrium(mechanism))
        self._diagram: BifurcationDiagram | None = None

    @property
    def _mechanism(self) -> Mechanism:
        return self._equilibrium.mechanism

    def _set(self, equilibrium: Equilibrium) -> None:
        """Take a state, and find all others at its inputs and load."""
        found = solve_forward(equilibrium.mechanism, equilibrium.inputs, equilibrium.load, RHO_MAX)
        own = [
            n
            for n, each in enumerate(found)
            if np.abs(each.state - equilibrium.state).max() < _SAME * (1.0 + np.abs(each.state).max())
        ]
        self._all = tuple(found) if own else (*found, equilibrium)
        self._number, self._equilibrium = (own[0] if own else len(found)), equilibrium

    def _state(self, event: Event = Event.NONE, fall: Data | None = None) -> Data:
        return {
            "kind": "state",
            "inputs": self._equilibrium.inputs.tolist(),
            "load": self._equilibrium.load.tolist(),
            "number": self._number,
            "event": str(event),
            "message": event.message if event != Event.NONE else "",
            "fall": fall,
            "equilibria": plain([equilibrium_view(each) for each in self._all]),
        }

    def _move(self, inputs: Any = None, load: Any = None) -> Data:
        here = self._equilibrium
        target = np.array(here.inputs) if inputs is None else self._within_limits(self._mechanism.check_inputs(inputs))
        wanted = np.array(here.load) if load is None else self._mechanism.check_load(load)
        return self._arrive(*self._followed(here, target, wanted))

    def _within_limits(self, inputs: Array) -> Array:
        clipped: Array = np.clip(inputs, self._mechanism.lower_limits, self._mechanism.upper_limits)
        return clipped

    def _followed(self, start: Equilibrium, inputs: Array, load: Array) -> tuple[Equilibrium, Event]:
        """Return where the branch leads; an unstable one is followed through changes of its index."""
        tracker = BranchTracker(self._mechanism, start, follow_index_changes=not start.is_stable)
        step = tracker.step(inputs, load)
        return step.equilibrium, step.event

    def _arrive(self, equilibrium: Equilibrium, event: Event) -> Data:
        """Take a state that was followed; from where stability is lost the mechanism falls."""
        if event in (Event.FOLD, Event.INDEX_CHANGE) and self._equilibrium.is_stable:
            return self._fall(equilibrium, event)
        self._set(equilibrium)
        return self._state(event)

    def _fall(self, edge: Equilibrium | None = None, event: Event = Event.NONE) -> Data:
        edge = self._equilibrium if edge is None else edge
        fall = snap(edge)
        self._set(fall.equilibrium)
        told = {
            "is_landed": fall.is_landed,
            "message": fall.status.message,
            "energy_released": fall.energy_released,
            "energies": fall.energies,
            "from": equilibrium_view(edge),
        }
        return self._state(event, plain(told))

    def _drag(self, asked: messages.Drag) -> Data:
        mechanism, here, event = self._mechanism, self._equilibrium, Event.NONE
        goal = np.array(here.pose)
        goal[:2] = asked.place
        for _ in range(_CORRECTIONS):
            change = self._change_towards(here, goal)
            target = self._within_limits(here.inputs + change)
            here, event = self._followed(here, target, np.array(here.load))
            gap = mechanism.units.kernel_from_pose(goal - here.pose)
            if event != Event.NONE or np.abs(gap).max() < _NEAR:
                break
        return self._arrive(here, event)

    def _change_towards(self, here: Equilibrium, goal: Array) -> Array:
        """Return the change of the inputs that leads a pose towards another, to first order, and is not long."""
        units = self._mechanism.units
        jacobian = here.forward_jacobian / units.jacobian
        gap = units.kernel_from_pose(goal - here.pose)
        left, values, right = np.linalg.svd(jacobian)  # very large near a fold
        change = right.T @ (left.T @ gap * (values / (values**2 + _DAMPING**2)))
        change *= min(1.0, _LONGEST / max(float(np.abs(change).max()), 1e-12))
        return units.inputs_from_kernel(change)

    def _pick(self, asked: messages.Pick) -> Data:
        if asked.number >= len(self._all):
            raise ValueError(f"there is no equilibrium {asked.number} here: there are {len(self._all)}")
        self._number, self._equilibrium = asked.number, self._all[asked.number]
        return self._state()

    def _folds(self, asked: messages.Folds) -> Data:
        here = self._equilibrium
        held = () if here.mechanism.leg_count == 2 else ((2, float(here.inputs[2])),)
        curves = _fold_curves(here.mechanism, tuple(here.load.tolist()), held)
        return {"kind": "folds", "name": here.mechanism.name, **plain(folds_view(curves))}

    def _make_diagram(self, asked: messages.Diagram) -> Data:
        here = self._equilibrium
        mechanism, is_input = here.mechanism, asked.along == "input"
        count = mechanism.leg_count if is_input else mechanism.dof
        if asked.axis >= count:
            raise ValueError(f"there is no {asked.along} {asked.axis}: there are {count}")
        held = here.inputs if is_input else here.load
        largest = _LARGEST_LOAD * mechanism.units.load[asked.axis if not is_input else 0]
        first, last = mechanism.legs[asked.axis].actuator.limits if is_input else (-largest, largest)
        ends = np.tile(held, (2, 1))
        ends[:, asked.axis] = first, last
        along = {"inputs": ends, "load": here.load} if is_input else {"inputs": here.inputs, "load": ends}
        diagram = bifurcation_diagram(mechanism, along, RHO_MAX)
        self._diagram = diagram
        return {
            "kind": "diagram",
            "along": asked.along,
            "axis": asked.axis,
            **plain(diagram_view(diagram, float(first), float(last))),
        }

    def _go(self, asked: messages.Go) -> Data:
        diagram = self._diagram
        if diagram is None or diagram.mechanism != self._mechanism:
            raise ValueError("there is no diagram of this mechanism yet")
        if asked.branch >= len(diagram.branches) or asked.vertex >= len(diagram.branches[asked.branch]):
            raise ValueError(f"the diagram has no vertex {asked.vertex} on a branch {asked.branch}")
        self._set(diagram.branches[asked.branch].equilibrium(asked.vertex))
        return self._state()

    def _export(self, asked: messages.Export) -> Data:
        here = self._equilibrium
        name = self._mechanism.name
        is_in_catalogue = name in mechanism_names() and get_mechanism(name) == self._mechanism
        write: dict[str, Callable[[], str]] = {
            "svg": lambda: equilibrium_svg(here, ghosts=self._all),
            "json": partial(json_text, here),
            "python": partial(python_lines, here, is_in_catalogue),
        }
        endings = {"svg": "svg", "json": "json", "python": "py"}
        return {"kind": "file", "name": f"state.{endings[asked.form]}", "text": write[asked.form]()}


@lru_cache(maxsize=_MAPS)
def _fold_curves(
    mechanism: Mechanism, load: tuple[float, ...], held: tuple[tuple[int, float], ...]
) -> tuple[SingularCurve, ...]:
    return forward_singularities(mechanism, load, RHO_MAX, progress=False, held=dict(held), grid=6)
