"""The topic table: what a block of a topic may look like."""

from __future__ import annotations

from pzt_config.topics import TOPICS


def test_only_the_standard_deviations_of_an_estimate_may_be_left_out() -> None:
    estimate = TOPICS["estimate"]
    assert estimate.layouts == (estimate.columns, estimate.columns[:-3])
    assert all("_std" in name for name in estimate.optional)
    for topic in TOPICS.values():
        if topic.name != "estimate":
            assert topic.layouts == (topic.columns,) == (topic.required,)
