"""PyElastica: two Cosserat rods in a loop, relaxed to rest after each increment.

* Units are EI = L = 1, and mass 1 per length. Time goes on from increment to increment, as in any use of a dynamic
  simulator; nothing is started anew.
* The rods are as thick as the wanted error allows, for the thickness sets the largest stable time step: a
  radius r means EA = 4 / r^2, and stretch and shear move the tip. With r = 0.03 and 20 elements the error
  at rest is about 7e-4 L, as with 20 links of MuJoCo; with r = 0.015 and 50 elements about 2e-4 L.
* Rotary inertia is raised until shear waves ask for no smaller time step than axial ones; rest is not changed by it.
  The time step is 0.72 of what the axial waves allow.
* A fixed director clamps the middle of the first element, so a rod begins half an element behind its clamp: the error
  falls with the number of elements squared. From the clamp itself, as in the examples, it falls with the number alone.
* `FreeJoint` holds the tips with half of the stiffness of an element, which needs no smaller time step.
* After an increment a fixed time follows, which costs less than looking whether all is at rest: the shortest that
  leaves the error of the path near that of the loop at rest.
* `AnalyticalLinearDamper` with the constant, of 5 to 30, that brought the loop nearest to rest in that time.
"""

import math
from typing import Any

import numpy as np

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import BASES, HOME, inputs_on_path
from pcm_gym.arrays import Array

_PART_OF_LIMIT = 0.72
_RAMP, _REST = 1.0, 4.0  # time from straight rods to the place on the path, and at rest there
_RAMP_PARTS = 200


def _frame(angle: float) -> Array:
    """Return the directors of an element, (3, 3): out of the plane, sideways, along the tangent."""
    tangent, out = np.array([math.cos(angle), math.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
    return np.stack([out, np.cross(tangent, out), tangent])


def prepare(place: Places, elements: int, radius: float, damping: float, settling: float) -> Step:
    """Return the step of two rods of `elements` elements each, which have the time `settling` to come to rest."""
    import elastica

    class Loop(elastica.BaseSystemCollection, elastica.Constraints, elastica.Connections, elastica.Damping):
        """What a loop of rods is made of."""

    class DrivenClamp(elastica.ConstraintBase):
        """Holds the first node and element of a rod at a place and directors that change from outside."""

        def __init__(self, *_: object, position: Array, directors: Array, **kwargs: object) -> None:
            super().__init__(**kwargs)
            self.position, self.directors = position, directors

        def constrain_values(self, system: Any, time: float) -> None:
            system.position_collection[..., 0] = self.position
            system.director_collection[..., 0] = self.directors

        def constrain_rates(self, system: Any, time: float) -> None:
            system.velocity_collection[..., 0] = 0.0
            system.omega_collection[..., 0] = 0.0

    part = 1.0 / (elements - 0.5)
    axial_frequency = 4.0 * elements / radius
    shear_modulus = 27.0 / 28.0 / 3.0  # in Young's modulus, the correction of shear included
    shear_frequency = 2.0 / radius * math.sqrt(shear_modulus * ((2.0 / radius) ** 2 + (2.0 * elements) ** 2))
    more_inertia = max(1.0, (shear_frequency / axial_frequency) ** 2)
    time_step = _PART_OF_LIMIT * 2.0 / axial_frequency

    loop, rods, clamps = Loop(), [], []
    straight = (math.acos(BASES[1]), math.pi - math.acos(BASES[1]))
    for base, angle in zip(BASES, straight, strict=True):
        directors = _frame(angle)
        position = np.array([base, 0.0, 0.0]) - 0.5 * part * directors[2]
        rod = elastica.CosseratRod.straight_rod(
            elements,
            position,
            directors[2],
            directors[0],
            elements * part,
            radius,
            density=1.0 / (math.pi * radius**2),
            youngs_modulus=4.0 / (math.pi * radius**4),
        )
        rod.mass_second_moment_of_inertia[...] *= more_inertia
        rod.inv_mass_second_moment_of_inertia[...] /= more_inertia
        loop.append(rod)
        loop.constrain(rod).using(
            DrivenClamp,
            position=position,
            directors=directors,
            constrained_position_idx=(0,),
            constrained_director_idx=(0,),
        )
        loop.dampen(rod).using(elastica.AnalyticalLinearDamper, uniform_damping_constant=damping, time_step=time_step)
        rods.append(rod)
        clamps.append((position, directors))
    loop.connect(*rods, first_connect_idx=-1, second_connect_idx=-1).using(
        elastica.FreeJoint, k=2.0 * elements / radius**2, nu=0.0
    )
    loop.finalize()
    stepper, now = elastica.PositionVerlet(), np.float64(0.0)

    def move(target: Array, duration: float) -> None:
        nonlocal now
        for base, angle, (position, directors) in zip(BASES, target, clamps, strict=True):
            directors[:] = _frame(angle)
            position[:] = np.array([base, 0.0, 0.0]) - 0.5 * part * directors[2]
        for _ in range(round(duration / time_step)):
            now = stepper.step(loop, now, time_step)

    def step(target: Array) -> Array:
        move(target, settling)
        tips: Array = 0.5 * (rods[0].position_collection[:2, -1] + rods[1].position_collection[:2, -1])
        return tips

    for share in np.linspace(0.0, 1.0, _RAMP_PARTS):
        move(straight + share * (HOME - straight), _RAMP / _RAMP_PARTS)
    move(inputs_on_path()[place], _REST)
    return step
