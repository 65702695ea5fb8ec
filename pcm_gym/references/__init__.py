"""References without learning: what a learnt policy is measured against.

To be read in this order: `view` is what a controller sees, `controller` what it must do, `table` which there are and
what they are called. One file each: `standing_still`, `random`, `resolved_rate`, `shielded`, `predictive`, `planner`
(`plans`: what it remembers). `acting` makes policies of them, from observations to actions.
"""

from pcm_gym.references.acting import ReferencePolicy
from pcm_gym.references.controller import Controller
from pcm_gym.references.table import REFERENCES, Reference, new_reference
from pcm_gym.references.view import View

__all__ = ["REFERENCES", "Controller", "Reference", "ReferencePolicy", "View", "new_reference"]
