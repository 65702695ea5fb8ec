"""A trained model as a policy that needs NumPy only, with a card that says where it comes from."""

import json
from pathlib import Path
from typing import Any

from agents.experiments.config import ExperimentConfig, load_config
from agents.experiments.runs import EVALUATION, RunFolder, TrainedFiles
from agents.learners.export import network_of
from agents.learners.learner import load_model, load_normaliser
from agents.learners.settings import ModelError
from pcm_gym.policies import Policy


def exported(files: TrainedFiles) -> Policy:
    """Policy of a trained model.

    Its card holds the experiment, the steps of training, the versions of packages it was trained with, and, if the
    model has been evaluated, the results.

    Raises
    ------
    ModelError, ConfigError
        If the model, or a file beside it, cannot be read, or is of a kind that policies do not have.
    """
    config = load_config(files.config)
    model = load_model(config.algorithm, files.model)
    normaliser = None if files.normalisation is None else load_normaliser(files.normalisation)
    network = network_of(model, normaliser)
    return Policy(network, _card(config, model.num_timesteps, files))


def _card(config: ExperimentConfig, training_steps: int, files: TrainedFiles) -> dict[str, Any]:
    experiment = config.model_dump(mode="json")
    return {
        "environment": experiment["environment"],
        "algorithm": config.algorithm,
        "seed": config.seed,
        "training_steps": training_steps,
        "experiment": experiment,
        "versions": _read(RunFolder(files.config.parent).versions),
        "evaluation": _read(files.folder / EVALUATION),
    }


def _read(path: Path) -> Any:
    """Return what a JSON file holds; None where there is none."""
    if not path.exists():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ModelError(f"{path}: not valid JSON: {error}") from error
