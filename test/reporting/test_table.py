from __future__ import annotations

import pytest

from radcam_depth_ros.reporting.errors import ReportError
from radcam_depth_ros.reporting.table import Table


def test_a_row_of_another_length_is_refused():
    with pytest.raises(ReportError, match="2 columns, but 1 cells"):
        Table("odd", ("a", "b"), (("1",),))
