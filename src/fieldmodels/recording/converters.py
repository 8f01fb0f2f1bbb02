"""Files that no reader takes, and the tool that makes a table of each."""

from __future__ import annotations

from pathlib import Path

BLACKBOX = b"H Product:Blackbox"
TOOLS = {
    ".bbl": "a raw blackbox of Betaflight or INAV: `blackbox_decode {name}` makes a CSV of it",
    ".d7d": "a file of DewesoftX, which exports it as CSV, MATLAB or MDF (MF4)",
    ".dxd": "a file of DewesoftX, which exports it as CSV, MATLAB or MDF (MF4)",
    ".erg": "results of CarMaker, whose IPGControl exports them as CSV",
    ".hoot": "a log of Phoenix 6: `owlet {name} log.wpilog -f wpilog` makes a .wpilog of it",
    ".ld": "a log of MoTeC, whose i2 exports it as CSV",
    ".mldatx": "a session of Simulink's Data Inspector, which exports it as MAT or Excel file",
    ".pkl": "a pickle, which may run code when it is opened: if you trust it, let pandas write it, "
    "`pandas.read_pickle('{name}').to_parquet('log.parquet')`",
    ".pt": "tensors of PyTorch, which may run code when they are opened: if you trust it, let NumPy write "
    "them, `numpy.savez('log.npz', **torch.load('{name}'))`",
    ".rlog": "a log of AdvantageKit, which AdvantageScope exports as CSV or .wpilog",
    ".tdx": "values of a .tdm, which DIAdem saves as .tdms",
}


def advice(path: Path, start: bytes) -> str:
    """What a binary file is and how it becomes a table.

    Args:
        path: The file.
        start: Its first bytes.
    """
    ending = ".bbl" if start.startswith(BLACKBOX) else path.suffix.lower()
    known = TOOLS.get(ending, "a binary file of a kind that is not read; export it as CSV or Parquet")
    return known.format(name=path.name)
