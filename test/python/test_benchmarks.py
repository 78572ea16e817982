"""The page of the benchmarks, and the rates of p values and intervals by few draws (`make bench-rates`)."""

import json
import sys

from conftest import ROOT

sys.path.insert(0, str(ROOT / "test" / "bench"))
import pytest

import rates
import report


def test_the_page_is_written_from_the_figures():
    assert (ROOT / "docs" / "benchmarks.md").read_text() == report.page(report.load())


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


# --- rates of p values and coverage of intervals


FEW = 80
KNOWN = {"mean of two"}  # docs/theory/likelihood.md says that it is less


def wrong(found):
    """Claims that rates contradict, at a level at which one in a thousand sets of right ones has any."""
    judged = {name: rates.summary(said) for name, said in found.items() if name not in KNOWN}
    among = 10 * len(rates.CLAIMS)
    return [
        n for n, (rate, count, _) in judged.items() if rates.contradicted(rates.CLAIMS[n], rate, count, among)
    ]


def test_p_values_and_intervals_are_right_as_often_as_they_say():
    found = rates.rates(rates.CHEAP, FEW, 7001)
    assert wrong(found) == []
    assert len("\n".join(rates.table(found)).splitlines()) == 2 + len(found)


def test_fits_and_comparisons_of_clean_recordings_say_so():
    found = rates.rates(rates.COSTLY, 2, 7001)
    assert wrong(found) == []


def test_a_rate_that_is_too_high_is_noticed():
    claim = rates.Claim("", 0.01, rates.MOST)
    rate, count, (low, high) = rates.summary([[True]] * 8 + [[False]] * 72)
    assert rate == pytest.approx(0.1) and low < 0.1 < high
    assert rates.contradicted(claim, rate, count, 10) and not rates.contradicted(claim, 0.0, count, 10)
    # five things of a draw that are always alike are worth one
    assert rates.summary([[True] * 5] * 40 + [[False] * 5] * 40)[1] == pytest.approx(80)
