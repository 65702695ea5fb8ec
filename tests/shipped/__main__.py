"""Write again what comes with the package of the catalogue's scenes, after a change of what they come to.

From the repository's root: ``python -m tests.shipped``. It works out everything and reads nothing of the old files.
"""

import sys

from pcm_gym.tasks import shipped
from tests.shipped.scenes import NAMES, worked_out


def main() -> None:
    for name in NAMES:
        made = worked_out(name)
        shipped.write(shipped.FOLDER, made.home, made.roadmap, made.step)
        print(f"{len(made.roadmap)} nodes of {name}", file=sys.stderr)


if __name__ == "__main__":
    main()
