"""SHA-256 of files, of parts of files and of folders."""

import hashlib
import shutil
from pathlib import Path

import pytest

from tssgeom.errors import SourceError
from tssgeom.io.results.run_record import sha256_of

CORPUS = Path(__file__).parent / "corpus"


def test_a_part_has_the_digest_of_its_file():
    file = CORPUS / "lines_ascii.vtp"
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert sha256_of(file) == sha256_of(Path(f"{file}#2")) == digest


def test_a_folder_s_digest_is_that_of_its_files_and_their_names_wherever_it_lies(tmp_path):
    folder = Path(shutil.copytree(CORPUS / "colonoscope", tmp_path / "case"))
    assert sha256_of(folder) == sha256_of(CORPUS / "colonoscope")
    with (folder / "T.txt").open("ab") as file:
        file.write(b"400.0;\n")
    longer = sha256_of(folder)
    assert longer != sha256_of(CORPUS / "colonoscope")
    (folder / "T.txt").rename(folder / "T2.txt")
    assert sha256_of(folder) != longer


def test_a_missing_file_is_an_error_that_names_it(tmp_path):
    with pytest.raises(SourceError, match="cannot be read"):
        sha256_of(tmp_path / "none.csv")
