"""spec/check-report.schema.json against what `gstream check --json` prints of every vector."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from gstream_cli.main import main

SPEC = Path(__file__).parents[2] / "spec"
SCHEMA = json.loads((SPEC / "check-report.schema.json").read_text())
VECTORS = sorted((SPEC / "vectors").glob("[bg]*/*.gs[bt]"))  # of later versions there is no report
TYPES = {
    "object": (dict,), "array": (list,), "string": (str,), "integer": (int,), "boolean": (bool,),
    "number": (int, float), "null": (type(None),),
}  # fmt: skip
WORDS = {  # the part of JSON Schema that the schema uses, and faults knows
    "$schema", "title", "description", "type", "enum", "pattern", "minimum", "required",
    "properties", "additionalProperties", "propertyNames", "items",
}  # fmt: skip
SOUND = {
    "path": "a.gsb", "format": "block file", "quick": False, "ok": False, "errors": 1,
    "counts": {"GSB-0101": 1},
    "findings": [{"rule": "GSB-0101", "severity": "error", "place": "byte 0", "said": "no magic"}],
}  # fmt: skip


def faults(value: Any, schema: Any, at: str = "$") -> list[str]:
    """Where a value is not as a schema has it; [] if it is."""
    if schema is False:
        return [f"{at}: not in the schema"]
    assert schema.keys() <= WORDS
    found = []
    names = schema.get("type", list(TYPES))
    names = [names] if isinstance(names, str) else names
    if not any(type(value) in TYPES[name] for name in names):
        return [f"{at}: no {' or '.join(names)}"]
    if value not in schema.get("enum", [value]):
        found.append(f"{at}: none of {schema['enum']}")
    if "pattern" in schema and not re.search(schema["pattern"], value):
        found.append(f"{at}: not like {schema['pattern']}")
    if "minimum" in schema and value < schema["minimum"]:
        found.append(f"{at}: below {schema['minimum']}")
    if isinstance(value, dict):
        found += [f"{at}: no {name}" for name in schema.get("required", []) if name not in value]
        for name, item in value.items():
            found += faults(name, schema.get("propertyNames", {}), f"{at}, name {name}")
            rule = schema.get("properties", {}).get(name, schema.get("additionalProperties", {}))
            found += faults(item, rule, f"{at}.{name}")
    if isinstance(value, list):
        found += [f for item in value for f in faults(item, schema.get("items", {}), f"{at}[]")]
    return found


def test_a_report_of_every_vector_is_as_the_schema_has_it():
    assert VECTORS
    for path in VECTORS:
        for arguments in (["--json"], ["--json", "--quick"]):
            printed = CliRunner().invoke(main, ["check", str(path), *arguments]).stdout
            report = json.loads(printed)
            assert faults(report, SCHEMA) == [], path.name
            assert (report["path"], report["quick"]) == (str(path), "--quick" in arguments)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({}, None),
        ({"errors": -1}, "$.errors: below 0"),
        ({"errors": True}, "$.errors: no integer"),
        ({"format": "mesh"}, "$.format: none of"),
        ({"more": 1}, "$.more: not in the schema"),
        ({"counts": {"GSB-1": 1}}, "$.counts, name GSB-1: not like"),
        ({"counts": {"GSB-0101": 0}}, "$.counts.GSB-0101: below 1"),
        ({"findings": [{"rule": "GSB-0101"}]}, "$.findings[]: no severity"),
    ],
)
def test_a_report_that_is_otherwise_is_not_as_the_schema_has_it(change, fault):
    found = faults(SOUND | change, SCHEMA)
    assert (not found) if fault is None else found[0].startswith(fault)


def test_a_report_without_one_of_its_parts_is_not_as_the_schema_has_it():
    for name in SOUND:
        rest = {key: value for key, value in SOUND.items() if key != name}
        assert faults(rest, SCHEMA) == [f"$: no {name}"]
