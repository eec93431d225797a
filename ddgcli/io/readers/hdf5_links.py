"""What an HDF5 file may refer to: itself, and nothing else.

External links, external storage and virtual datasets name other files by path, and the HDF5 library opens
them without a question: a foreign file could carry any file of the user into the output.
"""

from __future__ import annotations

from typing import Any

from ddgcli.errors import MeshFileError, excerpt


def refuse_outside(file: Any) -> None:
    """Refuse an open HDF5 file with a link, a storage or a virtual dataset in another file.

    Parameters
    ----------
    file : h5py.File

    Raises
    ------
    MeshFileError
        Names the first such object.
    """
    from h5py import h5d, h5l, h5o

    def refuse(name: bytes, what: str) -> None:
        raise MeshFileError(
            f"'{excerpt(name, 60)}' of the HDF5 file {what}; what is outside the file is not read: "
            "store it inside"
        )

    hard: list[bytes] = []

    def visit(name: bytes, info: Any) -> bytes | None:  # an exception in here would break HDF5's lock
        if info.type not in (h5l.TYPE_SOFT, h5l.TYPE_HARD):
            return name
        if info.type == h5l.TYPE_HARD:
            hard.append(name)
        return None

    outside = file.id.links.visit(visit, info=True)
    if outside is not None:
        refuse(outside, "is a link to another file")
    for name in (name for name in hard if h5o.get_info(file.id, name).type == h5o.TYPE_DATASET):
        creation = h5d.open(file.id, name).get_create_plist()
        if creation.get_layout() == h5d.VIRTUAL:
            refuse(name, "is virtual, made of other datasets")
        if creation.get_layout() == h5d.CONTIGUOUS and creation.get_external_count():
            refuse(name, "is stored in another file")
