"""From a model of Stable-Baselines3 to a policy that needs NumPy only."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, CombinedExtractor
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from agents.learners.features import GoalErrorFeatures
from agents.learners.hyperparameters import ACTIVATIONS
from agents.learners.settings import ModelError
from pcm_gym.policies.network import OBSERVATION, Layer, Network, Normaliser

_DEFAULT_FINE = 1.0  # where features have no such distance


def network_of(model: BaseAlgorithm, normaliser: VecNormalize | None) -> Network:
    """Network that acts as the model does when it does not explore.

    Parameters
    ----------
    model
        With an actor of linear layers and one activation function, on a goal-based environment.
    normaliser
        Running statistics of the training, or None if it saw plain observations.

    Raises
    ------
    ModelError
        If the model is of another kind.
    """
    modules, extractor, output = _actor(model)
    layers = [own for own in modules if isinstance(own, nn.Linear)]
    names = {_activation(own) for own in modules if not isinstance(own, nn.Linear)} or {"tanh"}
    if len(names) > 1:
        raise ModelError(f"a policy has one activation function, the model has {', '.join(sorted(names))}")
    spaces: Any = model.observation_space
    try:
        return Network(
            keys=tuple(spaces),
            sizes=tuple(int(np.prod(own.shape)) for own in spaces.values()),
            features=_features(extractor),
            activation=names.pop(),
            output=output,
            fine=getattr(extractor, "fine", _DEFAULT_FINE),
            layers=tuple(Layer(_numbers(own.weight).T.copy(), _numbers(own.bias)) for own in layers),
            normaliser=None if normaliser is None or not normaliser.norm_obs else _normaliser(normaliser),
        )
    except (TypeError, ValueError) as error:
        raise ModelError(f"the model cannot be exported: {error}") from error


def _actor(model: BaseAlgorithm) -> tuple[list[nn.Module], BaseFeaturesExtractor, str]:
    """Return the modules from features to actions, in order, what makes the features, and what bounds the actions."""
    policy: Any = model.policy
    if hasattr(policy, "action_net"):  # on-policy: actions are clipped
        return [*policy.mlp_extractor.policy_net, policy.action_net], policy.pi_features_extractor, "clip"
    actor = policy.actor
    if hasattr(actor, "latent_pi"):  # soft actor-critic and its kin: the mean is squashed
        return [*actor.latent_pi, actor.mu], actor.features_extractor, "tanh"
    *modules, squash = actor.mu
    if not isinstance(squash, nn.Tanh):
        raise ModelError(f"the model's actor ends in {type(squash).__name__}, not in a Tanh")
    return modules, actor.features_extractor, "tanh"


def _features(extractor: BaseFeaturesExtractor) -> str:
    if isinstance(extractor, GoalErrorFeatures):
        return "goal_error"
    if isinstance(extractor, CombinedExtractor):
        return "concatenated"
    raise ModelError(f"the model's features are {type(extractor).__name__}, which policies do not have")


def _activation(module: nn.Module) -> str:
    known: Iterable[tuple[str, type[nn.Module]]] = ACTIVATIONS.items()
    found = [name for name, kind in known if isinstance(module, kind)]
    if not found:
        raise ModelError(f"the model has a {type(module).__name__}, which is no activation function of policies")
    return found[0]


def _normaliser(normaliser: VecNormalize) -> Normaliser:
    statistics: Any = normaliser.obs_rms
    own = statistics[OBSERVATION]
    return Normaliser(own.mean.copy(), np.sqrt(own.var + normaliser.epsilon), float(normaliser.clip_obs))


def _numbers(parameter: Any) -> Any:
    return parameter.detach().cpu().numpy().astype(np.float32)
