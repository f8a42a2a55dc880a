"""What the verbs and their groups have in common: how their help looks, and that near matches are told."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from typer.core import TyperCommand, TyperGroup

from pieper.errors import unknown_name

_EXAMPLES = re.compile(r"^(?=For example:$)", re.MULTILINE)
_KEEP_LINES = "\b\n"  # before a paragraph whose lines are not to be filled again
_ELSE = "More"


class Verb(TyperCommand):
    """A verb whose help shows its examples line by line, as they are to be typed."""

    def __init__(self, name: str | None, *, help: str | None = None, **settings: Any) -> None:  # noqa: A002
        super().__init__(name, help=_EXAMPLES.sub(_KEEP_LINES, help or ""), **settings)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return what the line of usage says behind the name: arguments as they are typed, in brackets where they may be left out."""
        arguments = [param for param in self.get_params(ctx) if param.param_type_name == "argument"]
        return ["[OPTIONS]", *(_shown(str(each.metavar or each.name), required=each.required) for each in arguments)]


def _shown(words: str, *, required: bool) -> str:
    return words if required or words.startswith("[") else f"[{words}]"


class Group(TyperGroup):
    """Verbs in parts, each with its heading in the margin; it helps without arguments."""

    thing: ClassVar[str] = "verb"

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments."""
        return super().parse_args(ctx, args if args or ctx.resilient_parsing else ["--help"])

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the verb that was named, or say which are near."""
        name = args[0]
        if not name.startswith("-") and not ctx.resilient_parsing and self.get_command(ctx, name) is None:
            raise unknown_name(self.thing, name, [key for key, verb in self.commands.items() if not verb.hidden])
        return super().resolve_command(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Return what the line of usage says behind the name."""
        return [str(self.subcommand_metavar)]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the verbs, and then the names of the options."""
        self.format_commands(ctx, formatter)
        formatter.write_paragraph()
        names = [option.opts[0] for option in self.get_params(ctx) if option.opts[0].startswith("--")]
        formatter.write(f"Options: {', '.join(names)}\n")

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write one line for each verb, the verbs of a part together."""
        shown = {name: verb for name, verb in self.commands.items() if not verb.hidden}
        parts: dict[str, list[str]] = {}
        for name, verb in shown.items():
            parts.setdefault(getattr(verb, "rich_help_panel", None) or _ELSE, []).append(name)
        margin, wide = max(map(len, parts)), max(map(len, shown))
        formatter.write_paragraph()
        for part, names in parts.items():
            for k, name in enumerate(names):
                summary = shown[name].get_short_help_str(200)
                formatter.write(f"{'' if k else part:{margin}}  {name:{wide}}  {summary}\n")
