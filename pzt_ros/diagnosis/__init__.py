"""From measured runs to the effect that the model lacks."""

from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.report import Report

__all__ = ["Report", "diagnose"]
