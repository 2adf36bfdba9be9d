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

# Words of a section's name that stand for others, as ROS has it.
_ANY = {"*": r"/[^/]+", "**": r"(/[^/]+)*"}


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

    In the name of a section ``*`` is any word, ``**`` any number of them, as in ROS. Its own are
    those of the namespace. Where there are none for that, or none is told, they are those of
    whatever namespace.

    Raises
    ------
    VislamError
        Where they are of several namespaces and differ.
    """
    told = namespace.strip("/")
    found = _namespaces_of(node, parameters)
    if not found or told in found or "" in found:
        return _in_namespace(told, node, parameters)
    first, *others = found
    result = _in_namespace(first, node, parameters)
    for other in others:
        beside = _in_namespace(other, node, parameters)
        for name in sorted(result.keys() | beside.keys()):
            if result.get(name) != beside.get(name):
                raise VislamError(
                    f"/{first}/{node} and /{other}/{node} differ in {name}: tell --namespace, "
                    "or keep one"
                )
    return result


def names_for_all(parameters: Parameters, node: str) -> set[str]:
    """Names that only sections for every node hold: they may be of nodes that are not ours."""
    of_all, own = set[str](), set[str]()
    for section, values in parameters.items():
        if _last_word(section) in _ANY:
            of_all |= values.keys()
        elif _last_word(section) == node:
            own |= values.keys()
    return of_all - own


def _namespaces_of(node: str, parameters: Parameters) -> list[str]:
    """Namespaces by name that have parameters for a node, the first one first."""
    own = (name for name in parameters if _last_word(name) in (node, *_ANY) and name != "**")
    found = (name.rpartition("/")[0] for name in own)
    return list(dict.fromkeys(namespace for namespace in found if "*" not in namespace))


def _in_namespace(namespace: str, node: str, parameters: Parameters) -> dict[str, Any]:
    """Parameters of a node there, the more special ones over the more general ones."""
    full_name = f"{namespace}/{node}".strip("/")

    def generality(section: str) -> tuple[bool, bool, bool, bool]:
        is_for_all = _last_word(section) in _ANY
        return section == "**", is_for_all, "*" in section, section != full_name

    own = (name for name in parameters if name == node or _is_named(full_name, name))
    result: dict[str, Any] = {}
    for section in sorted(own, key=generality, reverse=True):
        result |= parameters[section]
    return result


def _last_word(section: str) -> str:
    return section.rpartition("/")[2]


def _is_named(full_name: str, section: str) -> bool:
    words = (_ANY.get(word, re.escape(f"/{word}")) for word in section.split("/"))
    return re.fullmatch("".join(words), f"/{full_name}") is not None


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
