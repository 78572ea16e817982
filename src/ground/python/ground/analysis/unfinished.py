"""What long work has finished so far, so that the next try need not do it again."""
import hashlib
import os
import pickle
import shutil
import threading

from ground import files


class Unfinished:
    """Results of the parts of one piece of work, kept in a folder until all of it is done.

    folder: None keeps nothing. identity: whatever the results depend on, can be pickled; results of
    other work are not taken for those of this one.
    """

    def __init__(self, folder=None, identity=None):
        self._folder = folder
        self._identity = pickle.dumps(identity) if folder else b""
        self._lock = threading.Lock()
        self.taken = 0  # results of an earlier try
        if folder:
            os.makedirs(folder, exist_ok=True)

    def result(self, part, compute):
        """What compute() gives, or gave in an earlier try; part: says which; its repr counts."""
        if not self._folder:
            return compute()
        name = hashlib.sha256(self._identity + repr(part).encode()).hexdigest()
        path = os.path.join(self._folder, name)
        try:
            with open(path, "rb") as file:
                found = pickle.load(file)
            with self._lock:
                self.taken += 1
            return found
        except Exception:
            pass  # never finished, or damaged: what a pickle then raises can be anything
        found = compute()
        with files.new_file(path, force=True) as temporary:
            with open(temporary, "wb") as file:
                pickle.dump(found, file)
        return found

    def done(self):
        """All is finished: nothing need be kept."""
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)
