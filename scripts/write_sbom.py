"""Writes the bill of materials of the wheel as CycloneDX: `write_sbom.py PYTHON FILE`.

PYTHON is of an environment with the wheel and its requirements alone. cyclonedx-bom lists what is installed; the
package becomes its subject, and the shipped weights become components with their SHA-256.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.model.license import DisjunctiveLicense
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

PACKAGE = "radcam-depth-ros"
OF_THE_ENVIRONMENT = ("pip", "setuptools")
"""In each environment; they are listed only where something needs them."""


def weights(python: Path) -> list[Component]:
    """The weight files of the installed package."""
    where = "import radcam_depth_ros as r; print(r.__path__[0])"
    place = subprocess.run([python, "-I", "-c", where], capture_output=True, text=True, check=True).stdout.strip()
    return [
        Component(
            name=path.name,
            type=ComponentType.MACHINE_LEARNING_MODEL,
            bom_ref=f"weights/{path.name}",
            hashes=[HashType(alg=HashAlgorithm.SHA_256, content=hashlib.sha256(path.read_bytes()).hexdigest())],
            licenses=[DisjunctiveLicense(id="Apache-2.0")],
        )
        for path in sorted(Path(place, "weights").glob("*.safetensors"))
    ]


def bill(python: Path) -> Bom:
    """The bill of an environment, with the package as its subject."""
    listing = [
        sys.executable,
        "-m",
        "cyclonedx_py",
        "environment",
        "--output-reproducible",
        "--no-validate",
        str(python),
    ]
    # Without PYTHONPATH: metadata that a build left in a checkout would be listed as a second package of that name.
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    listed = subprocess.run(listing, env=variables, capture_output=True, text=True, check=True).stdout
    found: Bom = Bom.from_json(json.loads(listed))  # type: ignore[attr-defined]  # by a decorator
    needed = {child.ref for entry in found.dependencies for child in entry.dependencies}
    for component in list(found.components):
        if component.name.replace("_", "-") == PACKAGE:
            # Where it was installed from is a path of this machine; the hash there is the wheel's.
            component.hashes = [value for place in component.external_references for value in place.hashes]
            component.external_references = []
            found.components = [other for other in found.components if other is not component]
            found.metadata.component = component
        elif component.name in OF_THE_ENVIRONMENT and component.bom_ref not in needed:
            found.components = [other for other in found.components if other is not component]
            found.dependencies = [entry for entry in found.dependencies if entry.ref != component.bom_ref]
    shipped = weights(python)
    found.components.update(shipped)
    if found.metadata.component is None:
        raise SystemExit(f"{PACKAGE} is not installed for {python}")
    found.register_dependency(found.metadata.component, shipped)
    return found


def main(arguments: list[str]) -> None:
    """Writes the file once it is valid."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("python", type=Path)
    parser.add_argument("out", type=Path)
    given = parser.parse_args(arguments)
    text = JsonV1Dot6(bill(given.python)).output_as_string(indent=2)
    if problem := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        raise SystemExit(f"the bill of materials is not valid: {problem}")
    given.out.write_text(f"{text}\n", encoding="utf-8")
    print(f"wrote {given.out}")


if __name__ == "__main__":
    main(sys.argv[1:])
