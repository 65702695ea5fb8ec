"""Gymnasium environments: one single class, one batched class, one table, and wrappers."""

from typing import TYPE_CHECKING

from pcm_gym.lazy import attribute_loader

if TYPE_CHECKING:
    from pcm_gym.environments.arguments import EnvironmentArguments
    from pcm_gym.environments.batch import MechanismVectorEnv
    from pcm_gym.environments.preview import Preview
    from pcm_gym.environments.registration import environment_ids, register_environment, register_environments
    from pcm_gym.environments.rows import Info
    from pcm_gym.environments.single import MechanismEnv
    from pcm_gym.environments.wrappers import CostStep, SolverShield, VectorSolverShield

__all__ = [
    "CostStep",
    "EnvironmentArguments",
    "Info",
    "MechanismEnv",
    "MechanismVectorEnv",
    "Preview",
    "SolverShield",
    "VectorSolverShield",
    "environment_ids",
    "register_environment",
    "register_environments",
]

if not TYPE_CHECKING:
    # Registration, which `import pcm_gym` needs, comes without the compiled kernels that all others bring.
    __getattr__ = attribute_loader(
        __name__, __all__, rooms=("registration", "arguments", "rows", "preview", "single", "batch", "wrappers")
    )
