from __future__ import annotations

import json

import pytest

from radcam_depth_ros.bags import SCENARIO_TOPIC, BagError, BagReader, BagWriter, factory, read_scenario


def scenario_of(tmp_path, text, type_name="std_msgs/msg/String"):
    path = tmp_path / "drive.mcap"
    with BagWriter(path) as bag:
        bag.write("/other", factory("std_msgs/msg/String", data="x"), 0)
        if text is not None:
            bag.write(SCENARIO_TOPIC, factory(type_name, data=text), 1)
            bag.write(SCENARIO_TOPIC, factory(type_name, data=text), 2)
    with BagReader(path) as reader:
        return dict(read_scenario(reader))


def test_words_are_read(tmp_path):
    text = json.dumps({"weather": "rain", "time_of_day": "night", "seed": 3, "street": ""})
    assert scenario_of(tmp_path, text) == {"weather": "rain", "time_of_day": "night"}


def test_a_bag_need_not_have_one(tmp_path):
    assert scenario_of(tmp_path, None) == {}


def test_a_topic_of_another_type_is_something_else(tmp_path):
    assert scenario_of(tmp_path, True, "std_msgs/msg/Bool") == {}


@pytest.mark.parametrize("text", ["rain", "[1, 2]", ""])
def test_what_is_no_object_is_refused(tmp_path, text):
    with pytest.raises(BagError, match="must be a JSON object"):
        scenario_of(tmp_path, text)
