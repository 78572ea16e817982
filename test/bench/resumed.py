"""Benches whose results go to a file of JSON lines, so that an interrupted one continues where it stopped."""

import argparse
import functools
import json
import math
import os
import time

from ground.support.errors import GroundError


def parser(about, path):
    """A parser of the options that all of these benches have; path: where results go."""
    found = argparse.ArgumentParser(description=about)
    found.add_argument("--count", type=int, help="number of cases, of each kind if there are kinds")
    found.add_argument("--seed-base", type=int, default=1, help="seed of the first case (1)")
    found.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    found.add_argument("--hours", type=float, default=math.inf, help="begin no case after this time")
    found.add_argument("--results", default=path, help="file of JSON lines")
    found.add_argument("--markdown", help="file for the table")
    return found


def status(bench, options):
    """Runs a bench; returns its exit status, or what is wrong."""
    if options.jobs < 1 or (options.count is not None and options.count < 1):
        return "--count and --jobs must be positive"
    try:
        return bench(options)
    except (GroundError, OSError) as error:
        return str(error)


def results(team, path, wanted, key, key_of, run, hours=math.inf, noun="cases"):
    """Runs the wanted jobs without a result in a file, and returns the results of all wanted jobs that the
    file has then. team: workers.Workers; key(job) and key_of(result): equal for a job and its result;
    run(job): the result, a dictionary for a line of JSON; hours: none begins after this time [h]."""
    done = {key_of(result) for result in read(path)}
    left = [job for job in wanted if key(job) not in done]
    print("%d %s, %d of them to do" % (len(wanted), noun, len(left)), flush=True)
    os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
    end_last_line(path)
    deadline = time.time() + 3600 * hours
    with open(path, "a") as file:
        for result in team.map(functools.partial(_until, deadline, run), left):
            if result:
                file.write(json.dumps(result) + "\n")
                file.flush()
    asked = {key(job) for job in wanted}
    return [result for result in read(path) if key_of(result) in asked]


def _until(deadline, run, job):
    return run(job) if time.time() < deadline else None


def read(path):
    """Results of a file of JSON lines, none if there is no file; skips lines that were cut when a bench was
    killed."""
    found = []
    if os.path.exists(path):
        with open(path) as file:
            for line in file:
                try:
                    found.append(json.loads(line))
                except ValueError:
                    pass
    return found


def end_last_line(path):
    """Ends the last line of a file, which may have been cut when a bench was killed."""
    with open(path, "ab+") as file:
        file.seek(max(0, file.tell() - 1))
        if file.read() not in (b"", b"\n"):
            file.write(b"\n")
