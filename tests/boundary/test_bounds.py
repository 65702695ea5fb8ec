"""No kernel that environments use reads or writes beyond the end of an array: without compilation that is an error."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import pcm_gym
from tests.boundary.bounds import numbers
from tests.boundary.doors import home

ROOT = Path(__file__).parents[2]


def test_no_index_is_beyond_an_array() -> None:
    homes = {name: (home(name).state.tolist(), home(name).inputs.tolist()) for name in pcm_gym.mechanism_names()}
    expected = np.array(numbers(homes))
    assert np.isfinite(expected).all()
    result = subprocess.run(
        [sys.executable, "-W", "ignore::RuntimeWarning", "-m", "tests.boundary.bounds"],
        input=json.dumps(homes),
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    np.testing.assert_allclose(json.loads(result.stdout), expected, rtol=1e-7, atol=1e-8)
