"""The loss of PPO for a Gaussian policy, with its derivatives by what the networks put out, in closed form."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

_LOG_TWO_PI = math.log(2.0 * math.pi)


class Minibatch(NamedTuple):
    """Some steps of a rollout, or all of them."""

    features: Tensor  # (n, features)
    actions: Tensor  # (n, actuators), as they were drawn
    values: Tensor  # (n,), of the policy that acted
    log_probs: Tensor  # (n,), of the policy that acted
    advantages: Tensor  # (n,)
    returns: Tensor  # (n,)

    def chosen(self, rows: Tensor) -> "Minibatch":
        """Rows (m,) of it, copied."""
        return Minibatch(*(own.index_select(0, rows) for own in self))

    def part(self, first: int, last: int) -> "Minibatch":
        """Rows from `first` to before `last`, not copied."""
        return Minibatch(*(own[first:last] for own in self))


class Terms(NamedTuple):
    """What the loss is made of.

    Attributes
    ----------
    clip_range, clip_range_vf
        How far probability ratios, and values if at all, may move before they are no longer followed.
    ent_coef, vf_coef
        Weights of entropy and of the error of the values.
    normalises
        Whether advantages are normalised in each minibatch.
    """

    clip_range: float
    clip_range_vf: float | None
    ent_coef: float
    vf_coef: float
    normalises: bool


class Slopes(NamedTuple):
    """Derivatives of the loss by means (n, actuators), logarithms of deviations (actuators,) and values (n,)."""

    means: Tensor
    log_stds: Tensor
    values: Tensor


@torch.no_grad()
def surrogate(terms: Terms, batch: Minibatch, means: Tensor, log_stds: Tensor, values: Tensor) -> tuple[Slopes, Tensor]:
    """Derivatives of the clipped surrogate loss, and what a log tells of it, (5,): see `TOLD`.

    The loss is that of J. Schulman et al., 2017, "Proximal policy optimization algorithms", arXiv:1707.06347, as
    Stable-Baselines3 has it.
    """
    count, stds = len(means), log_stds.exp()
    deviations = (batch.actions - means) / stds
    log_probs = -0.5 * deviations.square().sum(1) - log_stds.sum() - 0.5 * means.shape[1] * _LOG_TWO_PI
    log_ratios = log_probs - batch.log_probs
    ratios = log_ratios.exp()
    advantages = batch.advantages
    if terms.normalises and count > 1:
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    followed = advantages * ratios
    clipped = advantages * ratios.clamp(1.0 - terms.clip_range, 1.0 + terms.clip_range)
    # where the clipped one is less, the ratio is beyond the range, and its derivative is zero
    by_log_probs = torch.where(followed <= clipped, followed, 0.0).div_(-count)[:, None]
    errors, by_values = _value_errors(terms, batch, values)
    slopes = Slopes(
        by_log_probs * deviations / stds,
        (by_log_probs * (deviations.square() - 1.0)).sum(0) - terms.ent_coef,
        by_values.mul_(2.0 * terms.vf_coef / count),
    )
    entropy = log_stds.sum() + 0.5 * means.shape[1] * (1.0 + _LOG_TWO_PI)
    told = torch.stack(
        [
            -torch.minimum(followed, clipped).mean(),
            errors.square().mean(),
            -entropy,
            (ratios - 1.0 - log_ratios).mean(),
            ((ratios - 1.0).abs() > terms.clip_range).float().mean(),
        ]
    )
    return slopes, told


# What `surrogate` tells of a minibatch, by the names that Stable-Baselines3 logs it under.
TOLD = ("policy_gradient_loss", "value_loss", "entropy_loss", "approx_kl", "clip_fraction")


def _value_errors(terms: Terms, batch: Minibatch, values: Tensor) -> tuple[Tensor, Tensor]:
    """Return the errors of the values (n,), and the same where the values are followed, else zero."""
    if terms.clip_range_vf is None:
        errors = values - batch.returns
        return errors, errors.clone()
    moves, reach = values - batch.values, terms.clip_range_vf
    errors = batch.values + moves.clamp(-reach, reach) - batch.returns
    return errors, torch.where(moves.abs() <= reach, errors, 0.0)
