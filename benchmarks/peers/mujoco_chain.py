"""MuJoCo: each rod a chain of rigid links, joined by hinges with springs, tips held together by a constraint.

Set up for statics, as an expert would:

* A hinge in the middle of each of n parts of length l = L / n, with half links at both ends, has the stiffness EI / l.
  So the error falls with n squared; with a hinge at the start of each part it falls with n alone.
* The clamps are mocap bodies: their angles are exact, and no servo has to settle.
* Gravity and contacts are off. The links have almost no mass; armature and damping of every hinge are in proportion to
  its stiffness instead. All modes then settle alike, without fast ones, and the time step can be large. This changes
  the way to rest, not the rest.
* The constraint is as stiff as the time step allows: `solref` of one time step (`refsafe` off), `solimp` near 1.
* After an increment a fixed number of `mj_step` follows, which costs less than looking whether all is at rest: as few
  as leave the error of the whole path at that of the chain at rest.
"""

import math

import numpy as np

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import BASES, HOME, inputs_on_path
from pcm_gym.arrays import Array

_TIME_STEP = 0.5
_DAMPING = 1.5  # of a hinge, in its stiffness
_ARMATURE = 1.0  # the same
_MASS = 1e-3  # of a rod
_RADIUS = 0.01  # of the links, which only show
_STIFF = 0.9999
_RAMP, _REST = 400, 400  # steps from straight rods to the place on the path, and at rest there

_MODEL = """
<mujoco>
  <option timestep="{time_step}" gravity="0 0 0" integrator="implicitfast" solver="Newton" tolerance="1e-10">
    <flag contact="disable" refsafe="disable"/>
  </option>
  <worldbody>{chains}</worldbody>
  <equality><connect site1="tip0" site2="tip1" solref="{time_step} 1" solimp="{stiff} {stiff} 0.001 0.5 2"/></equality>
</mujoco>
"""


def _link(length: float) -> str:
    return f'<geom type="capsule" size="{_RADIUS}" fromto="0 0 0 {length} 0 0" mass="{length * _MASS}"/>'


def _chain(rod: int, links: int) -> str:
    """Return a rod as nested bodies along x of its clamp's frame."""
    part, stiffness = 1.0 / links, float(links)
    spring = f'stiffness="{stiffness}" damping="{_DAMPING * stiffness}" armature="{_ARMATURE * stiffness}"'
    text, start = f'<body mocap="true" pos="{BASES[rod]} 0 0">{_link(0.5 * part)}', 0.5 * part
    for number in range(links):
        length = part if number < links - 1 else 0.5 * part
        text += f'<body pos="{start} 0 0"><joint type="hinge" axis="0 0 1" {spring}/>{_link(length)}'
        start = length
    return text + f'<site name="tip{rod}" pos="{start} 0 0"/>' + "</body>" * (links + 1)


def prepare(place: Places, links: int, steps: int) -> Step:
    """Return the step of chains of `links` links each, settled by `steps` time steps."""
    import mujoco

    chains = "".join(_chain(rod, links) for rod in range(len(BASES)))
    model = mujoco.MjModel.from_xml_string(_MODEL.format(time_step=_TIME_STEP, stiff=_STIFF, chains=chains))
    data = mujoco.MjData(model)

    def move(target: Array, count: int) -> None:
        for rod, angle in enumerate(target):
            data.mocap_quat[rod] = math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)
        mujoco.mj_step(model, data, count)

    def step(target: Array) -> Array:
        move(target, steps)
        mujoco.mj_kinematics(model, data)  # the tips at the end of the last step, not at its start
        tips: Array = 0.5 * (data.site_xpos[0, :2] + data.site_xpos[1, :2])
        return tips

    # Straight rods whose tips meet, as the constraint wants them from the first, then bent slowly.
    straight = np.array([math.acos(BASES[1]), math.pi - math.acos(BASES[1])])
    for part in np.linspace(0.0, 1.0, _RAMP):
        move(straight + part * (HOME - straight), 1)
    move(inputs_on_path()[place], _REST)
    return step
