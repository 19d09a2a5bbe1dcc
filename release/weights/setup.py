"""Builds the wheel radcam-depth-weights: weights that the wheel of the package itself leaves out."""

import os
from pathlib import Path
from xml.etree import ElementTree

from setuptools import setup

NAME = "radcam_depth_weights"
ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "radcam_depth_ros" / "weights"
DEFAULT = "baff"
VERSION = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")

setup(
    name=NAME,
    version=VERSION,
    description="Weights of more networks of radcam_depth_ros, which finds them by itself",
    long_description=Path("README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="radcam_depth_ros developers",
    maintainer_email="radcam-depth@example.org",
    python_requires=">=3.10",
    # The files stay where a checkout has them: this package is that folder.
    packages=[NAME],
    package_dir={NAME: os.path.relpath(FOLDER)},
    package_data={
        NAME: ["LICENSE", *sorted(path.name for path in FOLDER.glob("*.*") if not path.name.startswith(DEFAULT + "."))]
    },
    zip_safe=False,
)
