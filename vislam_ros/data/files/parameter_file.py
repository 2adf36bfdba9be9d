# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files: ``node: {ros__parameters: {name: value}}``.

Numbers follow ROS, where ``1e-10`` is a number; plain PyYAML would call it text.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vislam_ros.data.files.inputs import read_text
from vislam_ros.data.files.whole_file import replace_file
from vislam_ros.errors import VislamError

#: Node name, or ``**`` for every node -> parameter name -> value.
Parameters = dict[str, dict[str, Any]]

_SECTION = "ros__parameters"


# PyYAML takes a second for so many bytes [bytes], and one call of a function for each level.
_LARGEST, _DEEPEST = 1 << 17, 20


class _Loader(yaml.SafeLoader):
    """Safe loader that reads numbers with an exponent and no point or sign as ROS does.

    As ROS does, too, it takes no aliases, with which a few lines can hold any number of values.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose a node, but no alias and nothing nested beyond what anybody reads."""
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(problem="an alias: write the value", problem_mark=mark)
        if self._depth == _DEEPEST:
            raise yaml.MarkedYAMLError(problem="nested too deeply", problem_mark=mark)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


class _Dumper(yaml.SafeDumper):
    """Safe dumper that writes what :class:`_Loader` reads, lists on one line."""


for _class in (_Loader, _Dumper):
    _class.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+\Z"),
        list("-+.0123456789"),
    )
_Dumper.add_representer(
    list,
    lambda dumper, value: dumper.represent_sequence(
        "tag:yaml.org,2002:seq", value, flow_style=True
    ),
)


def parse_yaml(text: str, where: str) -> Any:
    """Plain values of a YAML text, with the numbers of ROS.

    Raises
    ------
    VislamError
        That begins with ``where``.
    """
    with _clear_errors(where):
        return yaml.load(text, Loader=_Loader)  # _Loader is a safe one


def read_yaml(path: Path, what: str) -> Any:
    """Plain values of a YAML file; an error says what it is that cannot be read."""
    return parse_yaml(read_text(path, what, _LARGEST), str(path))


@contextmanager
def _clear_errors(where: str) -> Iterator[None]:
    try:
        yield
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise VislamError(f"{where}, line {line}: not YAML: {error.problem}") from error
    except VislamError:
        raise
    except Exception as error:  # tags raise errors of every kind on values that are not theirs
        reason = str(error).partition("\n")[0]
        raise VislamError(f"{where}: not YAML: {reason or type(error).__name__}") from error


def read_parameters(path: Path) -> Parameters:
    """Read a parameter file.

    Nested names are joined by dots, nested namespaces by slashes; a node's leading slash is
    dropped, so that ``/**`` becomes ``**`` (see :func:`node_parameters`).

    Raises
    ------
    VislamError
        Naming the file and the line, where it is not such a file.
    """
    text = read_text(path, "these parameters", _LARGEST)
    with _clear_errors(str(path)):
        loader = _Loader(text)
        root = loader.get_single_node()
    if root is None:
        raise VislamError(f"{path}: holds no parameters: write node: {{{_SECTION}: {{...}}}}")
    return dict(_nodes(path, loader, root, ""))


def _nodes(
    path: Path, loader: _Loader, mapping: yaml.Node, namespace: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each node's full name and parameters from a mapping of nodes or namespaces."""
    for key, value in _items(path, mapping, "node names"):
        name = f"{namespace}/{key.value}".strip("/")
        children = {child.value: node for child, node in _items(path, value, f"{_SECTION}:")}
        if _SECTION not in children:
            yield from _nodes(path, loader, value, name)
        elif len(children) > 1:
            raise _error(path, key, f"{name} holds {_SECTION} and more beside it")
        else:
            yield name, dict(_values(path, loader, children[_SECTION], ""))


def _values(
    path: Path, loader: _Loader, mapping: yaml.Node, prefix: str
) -> Iterator[tuple[str, Any]]:
    """Yield each parameter's dotted name and value."""
    if mapping.tag == "tag:yaml.org,2002:null":
        return
    for key, value in _items(path, mapping, "parameter names"):
        name = f"{prefix}{key.value}"
        if isinstance(value, yaml.MappingNode):
            yield from _values(path, loader, value, f"{name}.")
            continue
        try:
            result = loader.construct_object(value, deep=True)
        except Exception as error:  # tags raise errors of every kind
            raise _error(path, value, f"{name} is {value.value!r}, which no value") from error
        items = result if isinstance(result, list) else [result]
        kinds = {type(item) for item in items}
        if len(kinds) > 1 or not kinds <= {bool, int, float, str}:
            raise _error(
                path,
                value,
                f"{name} is {result!r}: a parameter is true or false, a number, a text, or a "
                "list of one of these kinds",
            )
        yield name, result


def _items(path: Path, node: yaml.Node, what: str) -> list[tuple[yaml.ScalarNode, yaml.Node]]:
    """Keys and values of a mapping, refusing anything else and names that come twice."""
    if not isinstance(node, yaml.MappingNode):
        raise _error(path, node, f"expected a mapping of {what} here")
    seen = set()
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise _error(path, key, "a name is a plain text")
        if key.value in seen:
            raise _error(path, key, f"{key.value} is here for the second time: keep one")
        seen.add(key.value)
    return node.value


def _error(path: Path, node: yaml.Node, message: str) -> VislamError:
    return VislamError(f"{path}, line {node.start_mark.line + 1}: {message}")


def node_parameters(parameters: Parameters, node: str, namespace: str = "") -> dict[str, Any]:
    """Parameters of one node: those for every node, for every namespace, then its own.

    Its own are those of the namespace. Where there are none for that, or none is told, they are
    those of whatever namespace.

    Raises
    ------
    VislamError
        Where they are of several namespaces and differ.
    """
    result = dict(parameters.get("**", {}))
    own = {name: each for name, each in parameters.items() if name.rpartition("/")[2] == node}
    full_name = f"{namespace.strip('/')}/{node}"
    if full_name in own:
        own = {
            name: each for name, each in own.items() if name in (node, full_name) or "*" in name
        }
    else:
        _require_one({name: each for name, each in own.items() if "*" not in name})
    for name in sorted(own, key=lambda name: (name == full_name, "*" not in name)):
        result.update(own[name])
    return result


def _require_one(own: Parameters) -> None:
    """Refuse parameters of one node in several namespaces unless they are the same."""
    first, *others = own or {"": {}}
    for other in others:
        for name in sorted(own[first].keys() | own[other].keys()):
            if own[first].get(name) != own[other].get(name):
                raise VislamError(
                    f"/{first} and /{other} differ in {name}: tell --namespace, or keep one"
                )


def write_parameters(path: Path, parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Write a file that ``--params-file`` and :func:`read_parameters` take."""
    content = {
        "/**" if node == "**" else node: {
            _SECTION: {name: _plain(value) for name, value in values.items()}
        }
        for node, values in parameters.items()
    }
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=1000)
    replace_file(path, text.encode("utf-8"))


def _plain(value: Any) -> Any:
    """Value in the types of YAML: lists for tuples and arrays."""
    if isinstance(value, (bool, int, float, str)) and not isinstance(value, np.generic):
        return value
    return np.asarray(value).tolist()
