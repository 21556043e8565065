"""The files of a run: a press dataset that grows, with its journal."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError, DatasetError, reason_of
from palpate_edge.common.picture_file import write_picture
from palpate_edge.press_rig.journal import RigJournal, continued, read_journal, write_journal
from palpate_edge.press_rig.requests import Keep
from palpate_edge.press_rig.run_sequence import REFERENCES


class RunFiles:
    """The folder of one run. journal: as it is on the disk."""

    def __init__(self, folder: Path, sensor_toml: Path, fresh: RigJournal) -> None:
        """Make the folder, or continue the run that it holds.

        Raises ConfigError for a run of other settings or a folder with another dataset, DatasetError when
        the disk refuses.
        """
        self.folder = folder
        found = read_journal(folder)
        if found is None and (folder / "truth.csv").exists():
            raise ConfigError(f"{folder} holds another press dataset: give a new folder")
        self.journal = continued(found, fresh, folder)
        for part in ("reference", "frames"):
            make_folder(folder / part, DatasetError)
        target = folder / "sensor.toml"
        if sensor_toml.resolve() != target.resolve():
            try:
                shutil.copyfile(sensor_toml, target)
            except OSError as error:
                raise DatasetError(
                    f"{target} cannot be written: {reason_of(error)}; give another path"
                ) from None
        write_journal(folder, self.journal)

    @property
    def missing_references(self) -> range:
        """Return the numbers of the reference frames that were not taken."""
        return range(len(list((self.folder / "reference").glob("*.png"))), REFERENCES)

    def keep(self, kept: Keep) -> None:
        """Store an image, then its record: a break between them leaves an image that is taken again."""
        write_picture(self.folder / kept.path, kept.image, DatasetError)
        if kept.record is not None:
            records = (*self.journal.records, kept.record)
            self.journal = msgspec.structs.replace(self.journal, records=records)
            write_journal(self.folder, self.journal)
