"""The topic table: what a block of a topic may look like."""

from __future__ import annotations

from pzt_config.topics import TOPICS


def test_standard_deviations_may_be_left_out_and_nothing_else() -> None:
    estimate = TOPICS["estimate"]
    assert estimate.takes(estimate.columns)
    assert estimate.takes(estimate.columns[:-3])
    for count in (1, 2, 4):
        assert not estimate.takes(estimate.columns[:-count]), count
    assert not estimate.takes((*estimate.columns, "more"))


def test_other_topics_are_taken_as_they_stand() -> None:
    for topic in TOPICS.values():
        if topic.is_block and topic.name != "estimate":
            assert topic.takes(topic.columns)
            assert not topic.takes(topic.columns[:-1])
