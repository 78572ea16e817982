"""Writing so that nothing is half there and nothing is overwritten."""
import contextlib
import json
import math
import os
import tempfile

import yaml

from ground.errors import IdentifyError


def refuse_existing(path, force):
    """Raises IdentifyError when a file is there already; to be asked before long work starts."""
    if os.path.exists(path) and not force:
        raise IdentifyError("%s exists; choose another name, or --force to overwrite it" % path)
    folder = os.path.dirname(os.path.abspath(path))
    if not os.path.isdir(folder):
        raise IdentifyError("%s: there is no folder %s" % (path, folder))


@contextlib.contextmanager
def new_file(path, force=False):
    """Gives a temporary name beside `path`, which becomes `path` when the block ends well."""
    refuse_existing(path, force)
    folder, name = os.path.split(os.path.abspath(path))
    stem, extension = os.path.splitext(name)
    handle, temporary = tempfile.mkstemp(extension, "." + stem, folder)
    os.close(handle)
    try:
        yield temporary
        os.chmod(temporary, 0o644)
        if force:
            os.replace(temporary, path)
        else:
            try:
                os.link(temporary, path)
            except FileExistsError:
                raise IdentifyError("%s has come to exist meanwhile; left as it is" % path)
    finally:
        if os.path.exists(temporary):
            os.unlink(temporary)


def plain(value):
    """The same with None for numbers that JSON has no word for: infinite ones and NaN."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path, value, force=False):
    with new_file(path, force) as temporary:
        with open(temporary, "w") as file:
            json.dump(plain(value), file, indent=1, allow_nan=False)
            file.write("\n")


def write_yaml(path, value, force=False):
    with new_file(path, force) as temporary:
        with open(temporary, "w") as file:
            yaml.safe_dump(value, file, sort_keys=False)
