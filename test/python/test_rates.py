"""Rates of p-values and coverage of intervals, by few draws: `make bench-rates` takes more."""

import pytest

import rates

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
