"""The command line: ``python -m pcm_gym``, or ``pcm-gym``."""

from pcm_gym.commands.app import main

main()
