# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A class for messages that are a list of an installed message, where their package is missing.

The wheels have no ``tf2_msgs``, and a publisher needs the C structures that its package would
bring. ``tf2_msgs/msg/TFMessage`` is nothing but a list of ``geometry_msgs/msg/TransformStamped``,
which is there, so these structures are made of those: the type's name, its description and its
RIHS01 hash (REP 2011) are the true ones, and whoever subscribes sees no difference. Such a class
sends CDR bytes and does nothing else: what would convert a message fails, and says so.

The structures are those of the headers that come with ``rosidl_runtime_c``,
``rosidl_typesupport_fastrtps_cpp`` and ``rosidl_typesupport_introspection_c`` in Jazzy. So there
is no class with other wheels or another middleware, nor where the item's structures do not read
as they should.
"""

import ctypes
import functools
import importlib.metadata
from typing import Any

from rclpy.utilities import get_rmw_implementation_identifier
from rosbags.typesys import Stores, get_typestore

_DISPATCH = b"rosidl_typesupport_c"
_FASTRTPS = b"rosidl_typesupport_fastrtps_c"
_INTROSPECTION = b"rosidl_typesupport_introspection_c"
# Of type_description_interfaces/msg/FieldType, and of the introspection.
_UNBOUNDED_LIST_OF_MESSAGES = 145
_MESSAGE = 18

_HANDLE_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)
_GETTER = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)
_FAILS = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_void_p)


class _String(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_char_p),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    )


def _sequence_of(item: type[Any]) -> type[Any]:
    fields = (
        ("data", ctypes.POINTER(item)),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    )
    return type(f"_SequenceOf{item.__name__}", (ctypes.Structure,), {"_fields_": fields})


class _FieldType(ctypes.Structure):
    _fields_ = (
        ("type_id", ctypes.c_uint8),
        ("capacity", ctypes.c_uint64),
        ("string_capacity", ctypes.c_uint64),
        ("nested_type_name", _String),
    )


class _Field(ctypes.Structure):
    _fields_ = (("name", _String), ("type", _FieldType), ("default_value", _String))


_Fields = _sequence_of(_Field)


class _OneDescription(ctypes.Structure):
    _fields_ = (("type_name", _String), ("fields", _Fields))


_Descriptions = _sequence_of(_OneDescription)
_Sources = _sequence_of(ctypes.c_char)


class _Description(ctypes.Structure):
    _fields_ = (("own", _OneDescription), ("referenced", _Descriptions))


class _Hash(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


class _TypeSupport(ctypes.Structure):
    _fields_ = (
        ("identifier", ctypes.c_char_p),
        ("data", ctypes.c_void_p),
        ("function", ctypes.c_void_p),
        ("get_hash", _GETTER),
        ("get_description", _GETTER),
        ("get_sources", _GETTER),
    )


class _Callbacks(ctypes.Structure):
    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("serialize", ctypes.c_void_p),
        ("deserialize", ctypes.c_void_p),
        ("serialized_size", ctypes.c_void_p),
        ("max_serialized_size", ctypes.c_void_p),
        ("key_callbacks", ctypes.c_void_p),
    )


class _Member(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("type_id", ctypes.c_uint8),
        ("string_upper_bound", ctypes.c_size_t),
        ("members", ctypes.c_void_p),
        ("is_key", ctypes.c_bool),
        ("is_array", ctypes.c_bool),
        ("array_size", ctypes.c_size_t),
        ("is_upper_bound", ctypes.c_bool),
        ("offset", ctypes.c_uint32),
        ("default_value", ctypes.c_void_p),
        ("functions", ctypes.c_void_p * 6),
    )


class _Members(ctypes.Structure):
    _fields_ = (
        ("namespace", ctypes.c_char_p),
        ("name", ctypes.c_char_p),
        ("count", ctypes.c_uint32),
        ("size", ctypes.c_size_t),
        ("has_any_key", ctypes.c_bool),
        ("members", ctypes.POINTER(_Member)),
        ("initialize", ctypes.c_void_p),
        ("finalize", ctypes.c_void_p),
    )


class _Installed:
    """The C structures of a message class that is installed.

    Raises
    ------
    OSError, ValueError
        Where they are not as they should be.
    """

    def __init__(self, cls: Any):
        cls.__class__.__import_type_support__()
        self.capsules = cls.__class__
        address_of = ctypes.pythonapi.PyCapsule_GetPointer
        address_of.restype = ctypes.c_void_p
        address_of.argtypes = (ctypes.py_object, ctypes.c_char_p)
        handle = address_of(self.capsules._TYPE_SUPPORT, None)
        find = ctypes.CDLL("librosidl_runtime_c.so").get_message_typesupport_handle
        find.restype, find.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p)
        addresses = [find(handle, name) for name in (_FASTRTPS, _INTROSPECTION)]
        if not all(addresses):
            raise ValueError("no type support of Fast DDS")
        supports = [_TypeSupport.from_address(address) for address in addresses]
        self.fastrtps, self.introspection = supports
        self.introspection_address = addresses[1]
        self.callbacks = _Callbacks.from_address(self.fastrtps.data)
        self.description = _Description.from_address(self.fastrtps.get_description(addresses[0]))
        self._check(cls, _Hash.from_address(self.fastrtps.get_hash(addresses[0])))

    def _check(self, cls: Any, found: _Hash) -> None:
        package, name = cls.__module__.split(".")[0], cls.__name__
        msgtype = f"{package}/msg/{name}"
        members = _Members.from_address(self.introspection.data)
        read = (
            self.fastrtps.identifier,
            self.introspection.identifier,
            self.callbacks.namespace,
            self.callbacks.name,
            self.callbacks.key_callbacks,
            self.description.own.type_name.data,
            [members.members[k].name for k in range(min(members.count, 32))],
            f"RIHS0{found.version}_{bytes(found.value).hex()}",
        )
        if read != (
            *(_FASTRTPS, _INTROSPECTION, f"{package}::msg".encode(), name.encode(), None),
            msgtype.encode(),
            [field.encode() for field in cls.get_fields_and_field_types()],
            get_typestore(Stores.ROS2_JAZZY).hash_rihs01(msgtype),
        ):
            raise ValueError(f"{msgtype} does not read as it should")


@functools.cache
def list_message_class(msgtype: str, field: str, item: Any) -> Any:
    """Class of a message type with one field, a list of ``item``, for publishers of CDR bytes.

    Parameters
    ----------
    msgtype : str
        Such as ``tf2_msgs/msg/TFMessage``, known to rosbags, which works out its hash.
    field : str
    item : type
        Message class that is installed.

    Returns
    -------
    type or None
        None where it cannot be made, see above.
    """
    try:
        importlib.metadata.version("ros-jazzy-rclpy")
        if get_rmw_implementation_identifier() != "rmw_fastrtps_cpp":
            return None
        return _made(msgtype, field, _Installed(item))
    except (importlib.metadata.PackageNotFoundError, AttributeError, OSError, ValueError):
        return None


def _made(msgtype: str, field: str, item: _Installed) -> Any:
    package, _, name = msgtype.split("/")
    # As rosidl describes it: its own fields, then all types behind them by name.
    nested = _FieldType(_UNBOUNDED_LIST_OF_MESSAGES, 0, 0, item.description.own.type_name)
    fields = (_Field * 1)(_Field(_string(field), nested, _string("")))
    behind = [item.description.referenced.data[k] for k in range(item.description.referenced.size)]
    behind = sorted([*behind, item.description.own], key=lambda one: one.type_name.data)
    types = (_OneDescription * len(behind))(*behind)
    description = _Description(
        _OneDescription(_string(msgtype), _Fields(fields, 1, 1)),
        _Descriptions(types, len(behind), len(behind)),
    )
    number = bytes.fromhex(get_typestore(Stores.ROS2_JAZZY).hash_rihs01(msgtype).split("_")[1])
    type_hash, sources = _Hash(1, (ctypes.c_uint8 * 32)(*number)), _Sources(None, 0, 0)
    getters = tuple(_returning(one) for one in (type_hash, description, sources))

    fails = _FAILS(lambda *_: False)
    callbacks = _Callbacks.from_buffer_copy(item.callbacks)
    callbacks.namespace, callbacks.name = f"{package}::msg".encode(), name.encode()
    callbacks.serialize = callbacks.deserialize = ctypes.cast(fails, ctypes.c_void_p)
    member = _Member(field.encode(), _MESSAGE, 0, item.introspection_address, False, True)
    members = _Members(f"{package}__msg".encode(), name.encode(), 1, ctypes.sizeof(_Sources))
    members.members = (_Member * 1)(member)

    supports = {
        _FASTRTPS: _TypeSupport(
            _FASTRTPS, ctypes.addressof(callbacks), item.fastrtps.function, *getters
        ),
        _INTROSPECTION: _TypeSupport(
            _INTROSPECTION, ctypes.addressof(members), item.introspection.function, *getters
        ),
    }

    addresses = {name: ctypes.addressof(support) for name, support in supports.items()}
    choose = _HANDLE_FUNCTION(lambda _handle, identifier: addresses.get(identifier))
    dispatch = _TypeSupport(_DISPATCH, None, ctypes.cast(choose, ctypes.c_void_p), *getters)
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype = ctypes.py_object
    capsule.argtypes = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
    attributes = {
        "_TYPE_SUPPORT": capsule(ctypes.addressof(dispatch), None, None),
        # rclpy asks for these; what they would be used for fails before.
        **{
            name: getattr(item.capsules, name)
            for name in (
                "_CREATE_ROS_MESSAGE",
                "_CONVERT_FROM_PY",
                "_CONVERT_TO_PY",
                "_DESTROY_ROS_MESSAGE",
            )
        },
        "__import_type_support__": classmethod(lambda _cls: None),
        # What C points to must stay.
        "_kept": (
            *(dispatch, choose, supports, callbacks, fails, members, description, types, fields),
            *(type_hash, sources, getters),
        ),
    }
    return type(f"Metaclass_{name}", (type,), attributes)(name, (), {})


def _string(text: str) -> _String:
    return _String(text.encode(), len(text), len(text) + 1)


def _returning(structure: ctypes.Structure) -> Any:
    address = ctypes.addressof(structure)
    return _GETTER(lambda _handle: address)
