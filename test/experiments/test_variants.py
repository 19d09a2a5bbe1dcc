from __future__ import annotations

import pytest

from experiments.variants import FORMS, SHIPPED
from radcam_depth_ros import networks


@pytest.mark.parametrize("name", FORMS)
def test_each_form_can_be_built(name: str) -> None:
    form = networks.create("baff", FORMS[name]).config
    assert (form == networks.create("baff").config) == (name == SHIPPED)
