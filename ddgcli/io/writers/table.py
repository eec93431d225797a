"""Bytes of .csv files: one row per vertex."""

from __future__ import annotations

from ddgcli.io.writers.cell_data import CellData, columns_of, free_name, two_dimensional, warn_of_lost_arrays


def csv_bytes(data: CellData) -> bytes:
    """Columns `vertex`, `x`, `y`, `z` and the arrays on vertices; a vector `a` becomes `a_x`, `a_y`, `a_z`.

    Numbers are in the shortest form that reads back equal; faces and arrays on faces are left out.
    """
    warn_of_lost_arrays(data, ".csv", writable_names=tuple(data.vertex), what="faces and their arrays")
    columns: list[tuple[str, list]] = [("vertex", list(range(len(data.points))))]
    columns += [(name, data.points[:, k].tolist()) for k, name in enumerate("xyz")]
    used_names = {name for name, _ in columns}
    for name, value in data.vertex.items():
        columns += [
            (free_name(label, used_names, ".csv"), column.tolist())
            for label, column in columns_of(name, two_dimensional(value))
        ]
    head = ",".join(_quoted(name) for name, _ in columns)
    form = ",".join(["%r"] * len(columns)) + "\n"
    rows = "".join(form % row for row in zip(*(values for _, values in columns), strict=True))
    return f"{head}\n{rows}".encode()


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(c in name for c in ',"\n') else name
