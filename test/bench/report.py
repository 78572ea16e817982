#!/usr/bin/python3
"""Writes docs/benchmarks.md from test/bench/figures.json, after taking what benches have left in build/.

A row of figures.json with "keys" is replaced by the newest results of all of these keys, unless they are of
fewer cases. Results without a row are listed: give them one by hand. --check only says whether the page is
the one of the file.
"""

import argparse
import datetime
import json
import os
import re
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(HERE))
FIGURES = os.path.join(HERE, "figures.json")
PAGE = os.path.join(ROOT, "docs", "benchmarks.md")
HEAD = """\
# Benchmarks

`make bench-report` writes this page from `test/bench/figures.json`, after collecting the bench results
in `build/`. Intervals are 95% (Clopper and Pearson 1934 for rates) unless stated otherwise; "of" is
the number of cases. [Limits](limits.md) says what the rates mean.

Each section gives its command, date and computer; a row does so where it
differs.

MACHINES
"""
COLUMNS = ("what", "value", "interval", "of", "measured")


def load(path=FIGURES):
    """The figures: machines, and sections with their rows."""
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def save(figures, path=FIGURES):
    """Writes the figures with a row on each line."""
    lines = ['{"machines": %s,' % _json(figures["machines"]), '"sections": [']
    for number, section in enumerate(figures["sections"]):
        lines.append('{"title": %s,' % _json(section["title"]))
        lines.append(' "about": %s,' % _json(section["about"]))
        rows = ["  " + _json(row) for row in section["rows"]]
        last = number == len(figures["sections"]) - 1
        lines += [' "rows": [', ",\n".join(rows), " ]}" if last else " ]},"]
    with open(path, "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n]}\n")


def _json(value):
    return json.dumps(value, ensure_ascii=False)


def _measured(row):
    """Bench, date and computer of a row."""
    bench = "`%s`" % row["bench"] if row["bench"].startswith("make ") else row["bench"]
    return "%s, %s, %s" % (bench, row["date"], row["on"])


def page(figures):
    """The text of docs/benchmarks.md."""
    machines = ["- %s: %s" % one for one in figures["machines"].items()]
    parts = [HEAD.replace("MACHINES", "\n".join(machines))]
    for section in figures["sections"]:
        measured = [_measured(row) for row in section["rows"]]
        usual = max(measured, key=measured.count)
        rows = [dict(row, measured="" if m == usual else m) for row, m in zip(section["rows"], measured)]
        columns = [name for name in COLUMNS if any(row.get(name) for row in rows)]
        lines = ["## " + section["title"], "", "%s (%s)" % (section["about"], usual), ""]
        lines.append("|%s|" % "|".join(columns))
        lines.append("|%s" % ("---|" * len(columns)))
        lines += ["|%s|" % "|".join(row.get(name, "") for name in columns) for row in rows]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def results(folder):
    """What benches have left in a folder, by key: the columns that change."""
    found = {}
    for read in (_speed, _commands, _rates, _tables):
        found.update(read(folder))
    return found


def _file(folder, name):
    """Path of a file of results with its date; no path if it is missing."""
    path = os.path.join(folder, name)
    if not os.path.exists(path):
        return None, None
    return path, datetime.date.fromtimestamp(os.path.getmtime(path)).isoformat()


def _speed(folder):
    path, date = _file(folder, "bench.json")
    for row in load(path)["rows"] if path else []:
        least, largest, unit = row["least"], row["largest"], row["unit"]
        spread = "" if least == largest else "%.3g to %.3g %s" % (least, largest, unit)
        value = "%.3g %s" % (row["median"], unit)
        yield "bench: " + row["name"], dict(value=value, interval=spread, date=date)


def _commands(folder):
    path, date = _file(folder, "commands.json")
    for row in load(path)["rows"] if path else []:
        name, found = "%s %s" % (row["verb"], row["size"]), row["found"]
        if found["seconds"] is not None:
            yield "commands: " + name, dict(value="%.2g s" % found["seconds"], date=date)
            yield "memory: " + name, dict(value="%.2g GB" % (found["MB"] / 1000), date=date)


def _rates(folder):
    path, date = _file(folder, "rates.json")
    for row in load(path) if path else []:
        interval = "%.2g to %.3g%%" % (100 * row["low"], 100 * row["high"])
        value = "%.3g%%" % (100 * row["rate"]) + (", contradicts the claim" if row["contradicted"] else "")
        yield "rates: " + row["what"], dict(value=value, interval=interval, of=str(row["draws"]), date=date)


def _tables(folder):
    """Rates of the benches that leave a file of JSON lines."""
    for name in ("hidden", "mujoco", "discover"):
        path, date = _file(folder, name + ".jsonl")
        if not path:
            continue
        table, read = _lines(name)
        for what, share, count, interval, *_ in table(read(path))[1:]:
            yield "%s: %s" % (name, what), dict(value=share, interval=interval, of=count, date=date)


def _lines(name):
    """The function that makes the table of a bench from its results, and the one that reads them."""
    import discover_table
    import hidden_table
    import mujoco_bench
    import resumed

    tables = {"hidden": hidden_table.lines, "mujoco": mujoco_bench.lines, "discover": discover_table.lines}
    return tables[name], resumed.read


def _cases(*rows):
    """Number of cases of some rows together."""
    return sum(int(count) for row in rows for count in re.findall(r"\d+", row.get("of", "")))


def take(figures, found):
    """Puts results into the rows that name their keys; returns the keys that no row names."""
    rows = [row for section in figures["sections"] for row in section["rows"] if "keys" in row]
    for row in rows:
        new = [found[key] for key in row["keys"] if key in found]
        if len(new) == len(row["keys"]) and _cases(*new) >= _cases(row):
            for name in ("value", "interval", "of"):
                texts = [one.get(name, "") for one in new]
                text = "; ".join(texts[:1] if name == "of" and len(set(texts)) == 1 else texts)
                row[name] = text if any(texts) else ""
            row["date"] = max(one["date"] for one in new)
    named = {key for row in rows for key in row["keys"]}
    return sorted(found.keys() - named)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--results", default=os.path.join(ROOT, "build"), help="folder of results (build)")
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args()
    figures = load()
    if arguments.check:
        with open(PAGE, encoding="utf-8") as file:
            return 0 if file.read() == page(figures) else "docs/benchmarks.md is old: make bench-report"
    for key in take(figures, results(arguments.results)):
        print("no row has the key: " + key)
    save(figures)
    with open(PAGE, "w", encoding="utf-8") as file:
        file.write(page(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
