#!/usr/bin/env python3
"""bench/record.py MACHINE.csv SET RESULT.json: writes the medians of a result of scripts/bench, bench/python.py or
bench/rivals_gpu.py into the table of a machine, in place of the rows that SET had there. bench/results/README.md explains it."""
import csv
import datetime
import json
import pathlib
import re
import sys

COLUMNS = ("set", "name", "median", "unit", "version", "date")
VERSION = pathlib.Path(__file__).parent.parent / "host/broadcl/version.h"
# What Google Benchmark has in each row besides the counters.
USUAL = {"name", "run_name", "run_type", "repetitions", "repetition_index", "threads", "iterations", "real_time", "cpu_time",
         "time_unit", "aggregate_name", "aggregate_unit", "family_index", "per_family_instance_index"}


def name_of(run_name):
    return re.sub(r"/(iterations:\d+|manual_time|real_time|process_time)", "", run_name)


def rounded(value):
    return f"{value:.{15 if float(value).is_integer() else 6}g}"


def figures(row):
    """(suffix of the name, value, unit) of each counter whose name may end in its unit."""
    for key, value in row.items():
        kind, _, unit = key.rpartition("_")
        yield (kind, value, unit) if unit in ("us", "ms") else (key, value, "")


def of_benchmarks(result):
    """(name, value, unit, version of a package) of the repetitions' medians, and of benchmarks that ran once."""
    rows = [row for row in result["benchmarks"] if row.get("aggregate_name", "median") == "median"]
    for row in sorted(rows, key=lambda row: row["family_index"]):  # they may have run in random order
        name = name_of(row["run_name"])
        yield name, row["real_time"], row["time_unit"], None
        for kind, value, unit in figures({key: value for key, value in row.items() if key not in USUAL}):
            yield f"{name} {kind}", value, unit, None


def of_packages(result):
    for row in result["results"]:
        where = f"{row.pop('scene')}/{row.pop('boxes')}/{row.pop('method')}"
        method = where.rpartition("/")[2].lower()
        version = next(version for package, version in result["versions"].items() if method.startswith(package.split("-")[0]))
        if "failed" not in row:
            for kind, value, unit in figures(row):
                yield f"{where} {kind}", value, unit, version


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    table, group, path = pathlib.Path(sys.argv[1]), sys.argv[2], pathlib.Path(sys.argv[3])
    result = json.loads(path.read_text(encoding="utf-8"))
    ours = ".".join(re.findall(r"VERSION_(?:MAJOR|MINOR|PATCH) (\d+)", VERSION.read_text(encoding="utf-8")))
    measured = datetime.date.fromtimestamp(path.stat().st_mtime).isoformat()
    date = result.get("context", {}).get("date", measured)[:10]
    found = (of_benchmarks if "benchmarks" in result else of_packages)(result)
    rows = [[group, name, rounded(value), unit, version or ours, date] for name, value, unit, version in found]
    if table.exists():
        with open(table, encoding="utf-8", newline="") as file:
            rows += [row for row in list(csv.reader(file))[1:] if row[0] != group]
    with open(table, "w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *sorted(rows, key=lambda row: row[0])])


if __name__ == "__main__":
    main()
