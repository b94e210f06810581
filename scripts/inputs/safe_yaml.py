"""Read untrusted YAML: plain data only, duplicate keys refused, one message that names file and line."""

from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, get_args, get_origin

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import AliasEvent

from rig.errors import InputError

LARGEST_BYTES = 1_000_000
LONGEST_SHOWN = 80


class _PlainComposer(Composer):
    def compose_node(self, parent, index):
        """Raise ComposerError at an alias, before what it stands for multiplies."""
        if self.parser.check_event(AliasEvent):
            mark = self.parser.peek_event().start_mark
            raise ComposerError(None, None, "YAML aliases (*name) are not allowed", mark)
        return super().compose_node(parent, index)


class _PlainConstructor(SafeConstructor):
    def check_mapping_key(self, node, key_node, mapping, key, value):
        """Raise ConstructorError for a key that is neither a word nor a whole number, and for one that stands twice."""
        if not isinstance(key, str | int):
            raise ConstructorError(None, None, f"key {key!r} is not a word", key_node.start_mark)
        if key in mapping:
            raise ConstructorError(None, None, f"key {key!r} stands twice", key_node.start_mark)
        return True


def reader():
    """Return a reader of YAML 1.2 that makes plain data and nothing else: ``load`` of a text raises YAMLError, ValueError."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = _PlainConstructor
    yaml.Composer = _PlainComposer
    return yaml


def load_yaml(path):
    """Return the mapping in a YAML file; raise InputError for anything else: tags that build objects, anchors that
    multiply, keys that stand twice, files over a megabyte.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > LARGEST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes; at most {LARGEST_BYTES} are read")
    try:
        return plain_data(path.read_text(encoding="utf-8"), path)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text ({error.reason})") from None


def plain_data(text, where):
    """Return the mapping in a YAML text; raise InputError naming ``where`` for what ``load_yaml`` refuses."""
    if len(text) > LARGEST_BYTES:
        raise InputError(f"{where}: {len(text)} characters; at most {LARGEST_BYTES} are read")
    try:
        data = reader().load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        what = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise InputError(f"{where}{line}: {what}") from None
    except ValueError as error:  # a number of 5000 digits, a 32nd of January
        raise InputError(f"{where}: {error}") from None
    except RecursionError:
        raise InputError(f"{where}: nested too deeply") from None
    if not isinstance(data, dict):
        raise InputError(f"{where}: expected keys and values, found {type(data).__name__}")
    return data


def validation_message(path, error, model):
    """Return one line for a pydantic ValidationError of ``model``: file, key, value, what is wrong, what is allowed."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "(top)"
    value = first.get("input")
    shown = "" if isinstance(value, dict | list) else f" is {str(value)[:LONGEST_SHOWN]!r}"
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        message = f"unknown key; known: {', '.join(_known_keys(model, first['loc'][:-1]))}"
        shown = ""
    more = f" (and {len(error.errors()) - 1} more)" if len(error.errors()) > 1 else ""
    return f"{path}: {key}{shown}: {message}{more}"


def _known_keys(model, loc):
    """Return the keys of the model at a place inside ``model``."""
    for part in loc:
        model = _without_none(_part_of(model, part))
    return [field.alias or name for name, field in model.model_fields.items()]


def _part_of(model, part):
    """Return the type of a part: a field of a model, a value of a dict or list, the model of a union with a tag."""
    if isinstance(model, type) and issubclass(model, BaseModel):
        return {field.alias or name: field.annotation for name, field in model.model_fields.items()}[part]
    if isinstance(model, UnionType):
        return next(m for m in get_args(model) if part in _tags(m))
    return get_args(model)[-1]


def _tags(model):
    """Return the words of which a model has to say one, as ``kind: shake``."""
    return {word for field in model.model_fields.values() for word in get_args(field.annotation)}


def _without_none(model):
    """Return the model of ``Model | None``, and a type without what is said of its values."""
    if get_origin(model) is Annotated:
        model = get_args(model)[0]
    if isinstance(model, UnionType) and NoneType in get_args(model):
        model = get_args(model)[0]
    return model
