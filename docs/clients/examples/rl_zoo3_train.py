"""rl_zoo3: a training by its command, with hyperparameters from a file."""

import subprocess
import sys
import tempfile
from pathlib import Path

HYPERPARAMETERS = """
PCM/2RFR-Reach-v0:
  policy: MultiInputPolicy
  n_timesteps: 1024
  n_steps: 256
"""


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ppo.yml"
        file.write_text(HYPERPARAMETERS, encoding="utf-8")
        options = ["--algo", "ppo", "--env", "PCM/2RFR-Reach-v0", "--gym-packages", "pcm_gym"]
        places = ["--conf-file", str(file), "--log-folder", folder]
        subprocess.run([sys.executable, "-m", "rl_zoo3.train", *options, *places], check=True)
    return 1024


if __name__ == "__main__":
    print(main())
