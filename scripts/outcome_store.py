"""A folder of outcomes of a diagnosis (gap.select.kept), each in a file named by all that it depends on."""

import contextlib
import hashlib
import pickle
from pathlib import Path

import job


class OutcomeStore:
    """Outcomes in a folder, written by this program alone.

    shared  files that all outcomes depend on, ``facts`` what else does (anything with a repr)
    effect_files  {effect: [its file, those of effects that it imports]}: an outcome depends on those of the effects it names
    """

    def __init__(self, folder, shared, facts, effect_files):
        self.folder = Path(folder)
        self.shared = _digest([repr(facts).encode(), *(Path(f).read_bytes() for f in sorted(shared))])
        self.of_effects = {name: _digest([Path(f).read_bytes() for f in files]) for name, files in effect_files.items()}
        self.used = set()

    def get(self, names, text):
        """Return what is kept of some effects under a text; None where there is nothing, or nothing that can be read."""
        path = self._path(names, text)
        with contextlib.suppress(Exception):  # a damaged pickle may raise any
            return pickle.loads(path.read_bytes())
        return None

    def put(self, names, text, value):
        """Keep a value of some effects under a text."""
        with job.write_atomically(self._path(names, text), "wb") as file:
            pickle.dump(value, file)

    def drop_unused(self):
        """Remove what was neither asked for nor kept by this run."""
        for path in self.folder.glob("*.pickle"):
            if path not in self.used:
                path.unlink()

    def _path(self, names, text):
        effects = [f"{name} {self.of_effects[name]}" for name in sorted(names) if name in self.of_effects]
        path = self.folder / f"{_digest([self.shared.encode(), text.encode(), *(e.encode() for e in effects)])}.pickle"
        self.used.add(path)
        return path


def _digest(parts):
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()
