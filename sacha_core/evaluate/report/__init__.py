"""The report of an ablation: tables, figures, and one page that a stranger can read."""

from __future__ import annotations

from sacha_core.evaluate.report.subject import Subject
from sacha_core.evaluate.report.write import ReportPaths, write_report

__all__ = ["ReportPaths", "Subject", "write_report"]
