"""Errors of options, said plainly."""

from __future__ import annotations

import typer
from typer.core import TyperGroup

#: What newer typers, which have pydantic judge options, put before a reason.
_PREFIX = "Value error, "


class PlainErrors(TyperGroup):
    """A group of commands: a value that an option does not take is refused in one sentence."""

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]
        """Run a command of the group."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.replace(_PREFIX, "")
            raise
