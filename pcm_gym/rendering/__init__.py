"""Pictures of equilibria: polylines, then frames (needs Pillow, the extra ``render``)."""

from pcm_gym.rendering.batches import tile_frames
from pcm_gym.rendering.camera import Camera
from pcm_gym.rendering.frame import FrameRenderer
from pcm_gym.rendering.polylines import Polylines, equilibrium_polylines
from pcm_gym.rendering.style import Style

__all__ = [
    "Camera",
    "FrameRenderer",
    "Polylines",
    "Style",
    "equilibrium_polylines",
    "tile_frames",
]
