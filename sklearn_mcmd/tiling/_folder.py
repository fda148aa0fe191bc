"""The folder of a run: what is done, so that a run that was ended goes on."""

import hashlib
import json
import os
import shutil
from pathlib import Path

from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._tile import tile_files

__all__ = ["WorkFolder", "key_of"]

MANIFEST = "manifest.json"


class WorkFolder:
    """Temporary files of a run, beside its output.

    The manifest is written when all points are in their cells. Its key tells whether what lies
    there was made of the same inputs, with the same parameters. What was not is removed.

    Parameters
    ----------
    target : path
        The output.
    key : str

    Attributes
    ----------
    path : Path
    cells, results : Path
    """

    def __init__(self, target, key):
        self.path = Path(f"{os.path.realpath(target)}.tiles")
        self.cells, self.results = self.path / "cells", self.path / "results"
        self.key = key
        self._manifest = self.path / MANIFEST
        stored = self._read()
        if self.path.exists() and not (stored or self._is_ours()):
            raise FileExistsError(
                f"{self.path} is in the way: it is where temporary files would be; move it"
            )
        if stored.get("key") != key:
            self.remove()
            self.cells.mkdir(parents=True)
            self.results.mkdir()

    @property
    def constants(self):
        """The constants of the whole cloud, or None if not all points are in cells."""
        stored = self._read()
        return Constants(**stored["constants"]) if stored else None

    def finish_cells(self, constants):
        """Remember that all points are in cells."""
        temporary = self._manifest.with_suffix(".part")
        temporary.write_text(json.dumps({"key": self.key, "constants": constants._asdict()}))
        os.replace(temporary, self._manifest)

    def is_done(self, cell):
        """Whether the results of a tile are there."""
        return tile_files(self.results, cell)[0].exists()

    def is_written(self, i):
        """Whether the i-th output was written before."""
        return (self.path / f"{i}.written").exists()

    def mark_written(self, i):
        (self.path / f"{i}.written").touch()

    def remove(self):
        shutil.rmtree(self.path, ignore_errors=True)

    def _read(self):
        try:
            return json.loads(self._manifest.read_text())
        except (OSError, ValueError):
            return {}

    def _is_ours(self):
        """Of a run that ended before its manifest; or an empty folder."""
        return {entry.name for entry in self.path.iterdir()} <= {"cells", "results"}


def key_of(catalog, estimator, tile_size, share, version):
    """A hash of all that results and tiles depend on."""
    paths = [str(path.resolve()) for path in catalog.paths]
    params = sorted(estimator.get_params().items())
    content = repr(
        (version, type(estimator).__name__, params, paths, catalog.stamps, tile_size, share)
    )
    return hashlib.sha256(content.encode()).hexdigest()
