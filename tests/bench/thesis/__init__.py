"""The thesis's experiments beside ours, as the tables and charts of docs/THESIS.md, all made from this checkout."""

from tests.bench.thesis.document import DOCUMENT, chart, table, written

__all__ = ["DOCUMENT", "chart", "table", "written"]
