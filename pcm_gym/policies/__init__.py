"""What has been learnt, to act upon: policies as files of plain numbers, which need NumPy and nothing else.

To be read in this order: `network` is the arithmetic from observations to actions, `files` how it is kept, `policy`
what a user holds, and `shipped` which policies come with the package.
"""

from pcm_gym.policies.files import PolicyError, PolicyNotFoundError
from pcm_gym.policies.policy import Policy
from pcm_gym.policies.shipped import PolicyKey, load_policy, shipped_policies

__all__ = ["Policy", "PolicyError", "PolicyKey", "PolicyNotFoundError", "load_policy", "shipped_policies"]
