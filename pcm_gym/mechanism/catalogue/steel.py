"""The rods of the catalogue, 1 m long, of spring steel."""

from pcm_gym.mechanism.materials import SPRING_STEEL
from pcm_gym.mechanism.rod import Rod, Round, Strip

STRIP = Rod(length=1.0, section=Strip(width=20e-3, thickness=0.5e-3), material=SPRING_STEEL)
"""On edge it stays in the plane, and bends to a radius of 5 cm before it yields."""

WIRE = Rod(length=1.0, section=Round(radius=1e-3), material=SPRING_STEEL)
"""Round, 1 mm in radius; it yields at a radius of 20 cm."""
