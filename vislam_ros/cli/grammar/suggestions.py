# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Wrong usage is answered with what was probably meant."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from vislam_ros.core.settings import nearest_name


class SuggestingParser(argparse.ArgumentParser):
    """A parser whose errors name the flag or the command that is most like a wrong one."""

    _words: Sequence[str] = ()
    _siblings: Mapping[str, "SuggestingParser"] = {}  # commands by name, itself among them

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse as argparse does, and remember what."""
        self._words = list(sys.argv[1:] if args is None else args)
        for command in self._commands().values():
            command._siblings = self._commands()
        return super().parse_known_args(args, namespace)

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> argparse.Namespace:
        """Parse all; what a command does not know is told with that command's usage."""
        arguments, unknown = self.parse_known_args(args, namespace)
        if unknown:
            parser = self._commands().get(getattr(arguments, "command", None), self)
            parser.error(f"unrecognized arguments: {' '.join(unknown)}")
        return arguments

    def error(self, message: str) -> NoReturn:
        """Print usage, what is wrong and what was probably meant, and exit with 2."""
        super().error(message + self._suggestion())

    def _suggestion(self) -> str:
        commands, flags = self._commands(), list(self._option_string_actions)
        for word in self._words:
            name = word.partition("=")[0]
            if name in ("--", "--ros-args"):
                break
            if name.startswith("--") and not any(flag.startswith(name) for flag in flags):
                if hint := self._flag_hint(name, flags):
                    return hint
            elif commands and not name.startswith("-"):
                return "" if name in commands else nearest_name(name, commands)
        return ""

    def _flag_hint(self, name: str, flags: Sequence[str]) -> str:
        """Name the flag that was probably meant, or the commands that have the one given."""
        # All flags have their dashes in common.
        near = nearest_name(name[2:], [flag[2:] for flag in flags if flag.startswith("--")])
        if near:
            return f"{near.removesuffix('?').replace('mean ', 'mean --')}, not {name}?"
        owners = [
            command
            for command, parser in self._siblings.items()
            if name in parser._option_string_actions
        ]
        if not owners:
            return ""
        return f"; vislam {', '.join(owners)} {'has' if len(owners) == 1 else 'have'} {name}"

    def _commands(self) -> dict[Any, "SuggestingParser"]:
        """Parsers of the commands by name, where there are some."""
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                return dict(action.choices)
        return {}
