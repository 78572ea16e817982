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
        {"what": what, "rate": 0.02, "low": 0.01, "high": 0.03, "draws": 2000, "contradicted": False}
        for what in ("bench: p below 5% where thrusters are equal", "something new")
    ]
    (tmp_path / "rates.json").write_text(json.dumps(rates))
    names = ("step, velocities: state", "step, velocities: five sensitivities", "step")
    rows = [{"name": name, "unit": "ns", "median": 15, "least": 14, "largest": 16} for name in names]
    (tmp_path / "bench.json").write_text(json.dumps({"rows": rows}))
    found = report.results(str(tmp_path))
    figures = report.load()
    assert report.take(figures, found) == ["bench: step", "rates: something new"]
    text = report.page(figures)
    assert "|step of the velocities; with five sensitivities|15 ns; 15 ns|14 to 16 ns; 14 to 16 ns|" in text
    assert "|bench: p below 5% where thrusters are equal (claimed: 5%)|2%|1 to 3%|2000|" in text


def test_a_part_of_a_bench_does_not_replace_the_whole(tmp_path):
    rate = {"what": "bench: p below 5% where thrusters are equal", "rate": 0.5, "draws": 7}
    (tmp_path / "rates.json").write_text(json.dumps([dict(rate, low=0.1, high=0.9, contradicted=False)]))
    figures = report.load()
    report.take(figures, report.results(str(tmp_path)))
    assert figures == report.load()


def test_every_key_is_one_that_a_bench_leaves():
    import discover_table
    import hidden_table
    import mujoco_bench
    import rates

    left = {"rates: " + claim.what for claim in rates.CLAIMS.values()}
    left |= {"hidden: " + row.what for row in hidden_table._rows()}
    left |= {"mujoco: " + row.what for row in mujoco_bench.ROWS}
    left |= {"discover: " + row.what for row in discover_table._rows()}
    left.add("discover: tracking error, final to given model, crafts with effects")
    rows = [row for section in report.load()["sections"] for row in section["rows"]]
    keys = {key for row in rows for key in row.get("keys", ())}
    assert {key for key in keys if not key.startswith(("bench: ", "commands: ", "memory: "))} <= left
    assert {"rates: " + claim.what for claim in rates.CLAIMS.values()} <= keys
