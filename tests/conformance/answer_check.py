"""`gstream check` as a validator that spec/conformance/run.py can ask: paths in, answers out."""

import json
import sys
from typing import Any

from gstream.check import check_file
from gstream.errors import CorruptFileError, UnsupportedError


def answer(path: str) -> dict[str, Any]:
    """One answer of the protocol in spec/conformance/README.md."""
    try:
        report = check_file(path)
    except UnsupportedError:
        return {"valid": False, "codes": ["unsupported"]}
    except CorruptFileError as error:  # of neither format
        return {"valid": False, "codes": [error.rule]}
    return {"valid": report.ok, "codes": sorted(report.counts)}


for line in sys.stdin:
    print(json.dumps(answer(line.rstrip("\n"))), flush=True)
