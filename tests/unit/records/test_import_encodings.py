"""Texts in other encodings than UTF-8: read as told, or refused with the line; western words in Windows-1252 are recognised."""

import numpy as np
import pytest
from foreign_files import FORCE, POSITION, TIME, rows

import lumbar
from lumbar.base.errors import InputError

CHINESE = "试验机 3\n时间 [s],位移 [mm],力 [N]\n" + rows(",")
JAPANESE = "試験\n時間 [s],変位 [mm],荷重 [N]\n" + rows(",")
RUSSIAN = "время [s],перемещение [mm],сила [N]\n" + rows(",")
POLISH = "czas [s],przemieszczenie [mm],siła [N]\n" + rows(",")


@pytest.mark.parametrize(
    ("encoding", "text"),
    [
        ("gbk", CHINESE),
        ("gb18030", CHINESE),
        ("big5", "時間 [s],位移 [mm],力 [N]\n" + rows(",")),
        ("shift_jis", JAPANESE),
        ("euc_jp", JAPANESE),
        ("cp1251", RUSSIAN),
        ("koi8_r", RUSSIAN),
        ("cp1250", POLISH),
        ("iso8859-2", POLISH),
        ("cp850", "Zeit [s];Weg [mm];Prüfkraft [N]\n" + rows(";", ",")),
    ],
)
def test_an_encoding_is_told_or_asked_for(tmp_path, encoding, text):
    path = tmp_path / "trial.txt"
    path.write_bytes(text.encode(encoding))
    with pytest.raises(InputError, match=r"line 1 is not UTF-8 \(.*\); say .*--encoding gbk"):
        lumbar.import_recordings(path)
    [one] = lumbar.import_recordings(path, encoding=encoding)
    np.testing.assert_allclose(one.record["input"], POSITION, atol=2e-5)
    np.testing.assert_allclose(one.record["output"], FORCE, atol=2e-5)
    assert one.form.startswith(f"{encoding}, ")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_marked_texts_and_utf_8_are_read_without_a_word(tmp_path, encoding):
    (tmp_path / "trial.txt").write_bytes(CHINESE.encode(encoding))
    [one] = lumbar.import_recordings(tmp_path / "trial.txt")
    assert one.grounds["force"].startswith("column 3 '力' [N], by its name")
    [told] = lumbar.import_recordings(tmp_path / "trial.txt", encoding=encoding)
    assert told.record["output"] == pytest.approx(one.record["output"])


@pytest.mark.parametrize(
    "words",
    ["Prüfkraft, größer als 5 °C – N·m", "Déplacement créé à 20 µm²", "Deformação e medições", "±3 Ångström"],
)
def test_western_words_are_recognised_as_windows_1252(tmp_path, words):
    text = f"# {words}\ntime_s,position_mm,force_N\n" + rows(",", columns=(TIME, POSITION, FORCE))
    (tmp_path / "trial.txt").write_bytes(text.encode("cp1252"))
    [one] = lumbar.import_recordings(tmp_path / "trial.txt")
    assert one.form.startswith("Windows-1252, ")


def test_an_encoding_that_is_none_or_does_not_fit(run, tmp_path):
    path = tmp_path / "trial.txt"
    path.write_bytes(CHINESE.encode("gbk"))
    err = run.refused("import", path, "--encoding", "klingon", "--dry-run")
    assert "--encoding 'klingon': no encoding of text that Python knows, such as gbk" in err
    with pytest.raises(InputError, match="no encoding of text"):
        lumbar.import_recordings(path, encoding="base64")
    with pytest.raises(InputError, match=r"line 1 cannot be read by --encoding utf-8 \("):
        lumbar.import_recordings(path, encoding="utf-8")
