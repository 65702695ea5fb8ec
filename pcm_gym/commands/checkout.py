"""Commands that a checkout has beside the package: training and evaluation in `agents`, the paper's figures in `docs`.

They are no part of what is installed, and the package never imports them by itself: here they are looked for where a
checkout has them, and told what was asked for.
"""

import sys
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import typer

import pcm_gym
from pcm_gym.commands.errors import RefusalError

_CHECKOUT = Path(pcm_gym.__file__).parents[1]


@dataclass(frozen=True)
class CheckoutCommand:
    """A command of a checkout.

    Attributes
    ----------
    name, about : str
        As it is called, and what it does.
    module : str
        Of the checkout, with a Typer `app` of which this is a command, or with a function `main` that is one.
    """

    name: str
    about: str
    module: str

    def run(self, arguments: list[str]) -> None:
        """Run it as if it had been called with these arguments."""
        module = self._module()
        if hasattr(module, "app"):
            module.app([self.name, *arguments], prog_name="pcm-gym")
        else:
            app = typer.Typer(pretty_exceptions_enable=False)
            app.command()(module.main)
            app(arguments, prog_name=f"pcm-gym {self.name}")

    def _module(self) -> Any:
        package = self.module.partition(".")[0]
        folder = _CHECKOUT / package
        if not _CHECKOUT.joinpath(*self.module.split(".")).with_suffix(".py").is_file():
            raise RefusalError(
                f"`pcm-gym {self.name}` is a command of a checkout, which this installation is not: "
                "clone the repository and run `pip install -e '.[agents]'` in it"
            )
        if str(_CHECKOUT) not in sys.path:
            sys.path.append(str(_CHECKOUT))
        spec = find_spec(package)
        if spec is None or spec.origin is None or Path(spec.origin).parent != folder:
            where = spec.origin if spec else None
            raise RefusalError(f"another package named {package!r} ({where}) stands before the checkout's: {folder}")
        return import_module(self.module)


COMMANDS = (
    CheckoutCommand("train", "Train an agent, as a YAML file says.", "agents.commands.app"),
    CheckoutCommand("evaluate", "Judge a trained agent on held-out goals.", "agents.commands.app"),
    CheckoutCommand("export", "Write a trained agent as a policy that needs NumPy only.", "agents.commands.app"),
    CheckoutCommand("benchmark", "Train and judge all learners in all tiers, with all seeds.", "agents.commands.app"),
    CheckoutCommand("figures", "Draw the paper's figures and print their numbers.", "docs.figures.__main__"),
)


def add_to(app: typer.Typer) -> None:
    """Add the commands of a checkout to the command line."""
    for command in COMMANDS:
        # all that follows is the command's own, its --help too
        taken = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
        app.command(
            command.name,
            help=command.about,
            context_settings=taken,
            add_help_option=False,
            rich_help_panel="In a checkout",
        )(_runner(command))


def _runner(command: CheckoutCommand) -> Any:
    def run(context: typer.Context) -> None:
        command.run(list(context.args))

    return run
