"""The page of the benchmarks is the one of its figures, and takes what benches leave."""

import json
import sys

from conftest import ROOT

sys.path.insert(0, str(ROOT / "test" / "bench"))
import report


def test_the_page_is_written_from_the_figures():
    assert (ROOT / "docs" / "benchmarks.md").read_text() == report.page(report.load())


def test_the_figures_are_as_they_are_saved(tmp_path):
    report.save(report.load(), str(tmp_path / "figures.json"))
    assert (tmp_path / "figures.json").read_text() == (ROOT / "test" / "bench" / "figures.json").read_text()


def test_every_target_of_a_row_exists():
    makefile = (ROOT / "Makefile").read_text()
    rows = [row for section in report.load()["sections"] for row in section["rows"]]
    targets = {row["bench"].split()[1] for row in rows if row["bench"].startswith("make ")}
    assert [target for target in targets if "\n%s: " % target not in makefile] == []
    assert all(row["on"] in report.load()["machines"] for row in rows)


def test_what_benches_leave_is_taken(tmp_path):
    rates = [
        {"what": what, "rate": 0.02, "low": 0.01, "high": 0.03, "draws": 7, "contradicted": False}
        for what in ("bench: p below 5% where thrusters are equal", "something new")
    ]
    (tmp_path / "rates.json").write_text(json.dumps(rates))
    (tmp_path / "bench.json").write_text(
        json.dumps({"rows": [{"name": "step", "unit": "ns", "median": 15, "least": 14, "largest": 16}]})
    )
    found = report.results(str(tmp_path))
    figures = report.load()
    assert report.take(figures, found) == ["bench: step", "rates: something new"]
    assert found["bench: step"]["interval"] == "14 to 16 ns"
    text = report.page(figures)
    assert "|bench: p below 5% where thrusters are equal (claimed: 5%)|2%|1 to 3%|7|" in text


def test_every_key_of_rates_is_a_claim():
    import rates

    claims = {"rates: " + claim.what for claim in rates.CLAIMS.values()}
    rows = [row for section in report.load()["sections"] for row in section["rows"]]
    assert {row["key"] for row in rows if row.get("key", "").startswith("rates: ")} == claims
