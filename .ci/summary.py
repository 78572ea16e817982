#!/usr/bin/python3
"""Sums all JUnit results below a folder: the failures by name, then one line."""

import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def main(folder):
    passed, failed, skipped = 0, [], 0
    for path in sorted(pathlib.Path(folder).rglob("*.xml")):
        try:
            root = ElementTree.parse(path).getroot()
        except ElementTree.ParseError as error:
            failed.append("%s: not readable (%s)" % (path.name, error))
            continue
        for case in root.iter("testcase"):
            name = "%s: %s.%s" % (path.stem, case.get("classname", ""), case.get("name", ""))
            if case.find("failure") is not None or case.find("error") is not None:
                failed.append(name)
            elif case.find("skipped") is not None or case.get("status") == "notrun":
                skipped += 1
                reason = case.find("skipped")
                print("skipped: %s: %s" % (name, "" if reason is None else reason.get("message")))
            elif not path.name.startswith("rostest-"):  # repeats the result of another file
                passed += 1
    for name in failed:
        print("FAILED: " + name)
    print("%d passed, %d failed, %d skipped" % (passed, len(failed), skipped))
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
