#!/usr/bin/python3
"""Makes the pictures of the workbench in docs and README.md, from its story in test_workbench.py.

workbench_pictures.py [FOLDER]: FOLDER has the story's pictures already.
"""

import os
import pathlib
import subprocess
import sys
import tempfile

from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
PICTURES = {
    "1_first_light": "docs/howto/workbench_first.png",
    "3_zoomed_dark": "docs/howto/workbench_zoomed.png",
    "4_searching_light": "docs/howto/workbench_searching.png",
    "4_added_light": "docs/howto/workbench_added.png",
}
FALLING = ("2_fitted_light", "4_added_light", "5_added_light")  # README's picture: an error falls


def main(folder=None):
    folder = folder or tempfile.mkdtemp()
    if not os.listdir(folder):
        command = [sys.executable, "-m", "pytest", "-q", "test/python/test_workbench.py"]
        subprocess.run(command, cwd=ROOT, env=dict(os.environ, WORKBENCH_PICTURES=folder), check=True)
    for name, place in PICTURES.items():
        picture = Image.open("%s/%s.png" % (folder, name)).convert("RGB")
        picture.quantize(96).save(ROOT / place, optimize=True)
    first, *others = (Image.open("%s/%s.png" % (folder, n)).convert("RGB").quantize(96) for n in FALLING)
    times = [1500] * len(others) + [4000]  # of each picture [ms]
    place = ROOT / ".readme/workbench.gif"
    first.save(place, save_all=True, append_images=others, duration=times, loop=0)


if __name__ == "__main__":
    main(*sys.argv[1:])
