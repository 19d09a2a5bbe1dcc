#!/usr/bin/env bash
# Installs what Ubuntu lacks, or has too old, beside the system's packages: in the container of industrial_ci alone.
set -euo pipefail

apt-get install -y --no-install-recommends python3-pip
copy=$(mktemp -d) # the checkout is mounted read-only, and pip writes beside setup.py
cp -r . "$copy/package"
export PIP_BREAK_SYSTEM_PACKAGES=1 PIP_ROOT_USER_ACTION=ignore PIP_NO_CACHE_DIR=1
python3 -m pip install --index-url https://download.pytorch.org/whl/cpu torch
# Debian's packages cannot be uninstalled by pip: newer ones go before them, into /usr/local.
python3 -m pip install --ignore-installed -c constraints-jazzy.txt "$copy/package" \
    pytest pytest-timeout hypothesis
python3 -m pip uninstall -y radcam_depth_ros # what it needs stays; colcon builds the package itself
rm -rf "$copy"
