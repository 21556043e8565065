"""Each structure that Python gives to the kernels has the fields of one in C, in its order and types."""

from __future__ import annotations

import ctypes
import importlib
import pkgutil
import re

import pytest

from palpate_edge import kernels
from palpate_edge.kernels.library import FOLDER

C_TYPES = {
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
}
STRUCTURE = re.compile(r"^struct (\w+) \{\n(.*?)^\};", re.MULTILINE | re.DOTALL)
DECLARATION = re.compile(r"(?:const )?(?:struct )?(\w+) ([^;]+);")
COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)


def fields_in_c() -> dict[str, list[tuple[str, str]]]:
    """Name and type of each field of each structure; the type of an address is "*"."""
    found = {}
    for path in sorted(FOLDER.glob("*.[ch]")):
        for name, body in STRUCTURE.findall(COMMENT.sub("", path.read_text())):
            fields = []
            for kind, names in DECLARATION.findall(body):
                for one in names.split(","):
                    field = re.sub(r"\[\w+\]", "", one.strip().removeprefix("const "))
                    fields.append((field.lstrip("*"), "*" if field.startswith("*") else kind))
            found[name] = fields
    return found


def fields_in_python() -> dict[type[ctypes.Structure], list[tuple[str, str]]]:
    for module in pkgutil.iter_modules(kernels.__path__):
        importlib.import_module(f"{kernels.__name__}.{module.name}")
    names = {kind: name for name, kind in C_TYPES.items()}
    found = {}
    for structure in ctypes.Structure.__subclasses__():
        if structure.__module__.startswith(kernels.__name__):
            fields = []
            for name, kind, *_ in structure._fields_:
                element = getattr(kind, "_type_", kind) if issubclass(kind, ctypes.Array) else kind
                is_address = element is ctypes.c_void_p
                fields.append((name, "*" if is_address else names.get(element, "struct")))
            found[structure] = fields
    return found


IN_C, IN_PYTHON = fields_in_c(), fields_in_python()


def test_all_structures_are_read() -> None:
    assert len(IN_PYTHON) >= 15 and len(IN_C) >= len(IN_PYTHON)


@pytest.mark.parametrize("structure", IN_PYTHON, ids=lambda one: one.__name__)
def test_a_structure_has_the_fields_of_one_in_c(structure: type[ctypes.Structure]) -> None:
    fields = IN_PYTHON[structure]
    plain = {
        name: [(field, kind if kind in (*C_TYPES, "*") else "struct") for field, kind in in_c]
        for name, in_c in IN_C.items()
    }
    assert fields in plain.values(), f"{structure.__name__} {fields} is none of {sorted(plain)}"
