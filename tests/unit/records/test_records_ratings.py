"""The participants' sheet: every problem of a file is found at once, with its line."""

import numpy as np
import pytest

import lumbar
from refusing import has_tokens, refusal


def layout_of(keys):
    return lumbar.StudySettings.model_validate({"survey": {"layout": keys}}).survey.layout


def read_ratings(path, layout):
    return lumbar.read(path, "survey", layout=layout)


LAYOUT = layout_of(
    {
        "participant": "who",
        "models": [{"name": name, "column": f"rating_{name}"} for name in ("IL", "KB", "HO")],
        "scale_points": 5,
        "best": "best",
        "yes_no": ["clinician"],
        "experience": "years",
        "experience_levels": ["<5", ">=5"],
        "source": None,
    }
)
HEADER = "who,rating_IL,rating_KB,rating_HO,best,clinician,years"
GOOD = ["a,1,2,3,KB,yes,<5", "b,5.0,4,4,HO,0,>=5", "c,2,2,2,IL,True,<5"]


def written(tmp_path, *lines):
    path = tmp_path / "survey.csv"
    path.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return path


def test_answers_are_read_in_the_order_of_the_layout(tmp_path):
    ratings = read_ratings(written(tmp_path, *GOOD), LAYOUT)
    assert ratings.participants == ("a", "b", "c")
    assert ratings.scores_of("HO").tolist() == [3, 4, 2]
    assert ratings.counts().tolist() == [[1, 1, 0, 0, 1], [0, 2, 0, 1, 0], [0, 1, 1, 1, 0]]
    assert ratings.picks().tolist() == [1, 1, 1]
    assert ratings.groups["clinician"].tolist() == [True, False, True]
    assert ratings.experience == ("<5", ">=5", "<5")
    assert np.issubdtype(ratings.scores.dtype, np.integer)


def test_all_problems_of_survey_are_listed(tmp_path):
    lines = ["a,9,2.5,,KX,perhaps,10", "", "a,1,2,3,KB,1,<5", "b,1,2,3"]
    lines += [",1,2,3,KB,1,<5", "d,1,2,six,IL,1,<5"]
    message = refusal(read_ratings, written(tmp_path, *lines), LAYOUT)
    for entry in (
        "line 2: rating_IL … '9' … 1, 2, 3, 4, 5",
        "line 2: rating_KB … '2.5'",
        "line 2: best … 'KX' … IL, KB, HO",
        "line 2: clinician … 'perhaps'",
        "line 2: years … '10' … <5, >=5",
        "line 4: who … 'a'",
        "line 5: 4 cells … 7",
        "empty … line 2 (rating_HO), line 6 (who)",
        "line 7: rating_HO … 'six'",
    ):
        assert has_tokens(message, entry), entry
    assert "9 problems" in message


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (
            "1,,3,B 2,,4,A 3,4,5,C 4,4,5,NA 5,4,3,n/a 2,2,2,A 5,5,5,B 1,1,1,C",
            "line 2 (B), line 3 (B), line 5 (best), line 6",
        ),
        ("3.5,4,1,B 2,1,5,C 1,2,3,C", "line 2: A … 3.5 … double, then take 1 … scale_points: 9 … 9"),
        ("0,4,1,B 2,1,4,C 1,2,3,C", "line 2: A … 0 … add 1"),
        ("1,5,1,B 2,0,4,C 1,2,3,C", "line 3: B … 0 … add 1 … scale_points: 6"),
        ("1,5,2.5,B 2,0,4,C 1,2,3,C", "line 3: B … 0 … double … scale_points: 11"),
    ],
)
def test_cells_with_one_remedy_are_one_problem(tmp_path, content, problem):
    path = tmp_path / "survey.csv"
    rows = [f"P{number},{cells}" for number, cells in enumerate(content.split())]
    path.write_text("\n".join(["participant,A,B,C,best", *rows]))
    models = [{"name": name, "column": name} for name in "ABC"]
    layout = layout_of({"participant": "participant", "models": models, "scale_points": 5, "best": "best"})
    message = refusal(read_ratings, path, layout)
    assert "1 problem\n" in message and has_tokens(message, problem)
    path.write_text(path.read_text().replace(",", ";"))
    message = refusal(read_ratings, path, layout)
    assert "1 problem\n" in message and has_tokens(message, 'header … survey.layout.delimiter: ";"')


def test_missing_columns_and_wrong_cells_are_listed(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("who,rating_IL,best,years\na,9,IL,<5\nb,1,IL,<5\n")
    message = refusal(read_ratings, path, LAYOUT)
    for tokens in ("column 'rating_KB'", "column 'clinician'", "line 2: rating_IL … '9'"):
        assert has_tokens(message, tokens), tokens


@pytest.mark.parametrize(
    ("content", "tokens"),
    [
        (b"", "survey.csv … empty … who"),
        ((HEADER + "\n").encode(), "0 participants"),
        ((HEADER + "\n" + GOOD[0] + "\n").encode(), "1 participants"),
        (HEADER.replace("rating_KB", "rating_IL").encode() + b"\n", "header … 'rating_IL'"),
        (HEADER.encode() + b'\n"a,1,2,3', "line 2: 1 cells … 7"),
        (HEADER.encode() + b"\n\xff\xfe,1", "survey.csv … UTF-8"),
    ],
)
def test_files_without_answers_are_rejected(tmp_path, content, tokens):
    path = tmp_path / "survey.csv"
    path.write_bytes(content)
    assert has_tokens(refusal(read_ratings, path, LAYOUT), tokens)


def test_answer_in_quotes_may_span_lines(tmp_path):
    lines = [GOOD[0], '"b\nfrom afar",5,4,4,HO,0,>=5', "c,9,2,2,IL,True,<5"]
    message = refusal(read_ratings, written(tmp_path, *lines), LAYOUT)
    assert has_tokens(message, "line 5: rating_IL … '9'")
    assert read_ratings(written(tmp_path, *lines[:2]), LAYOUT).participants == ("a", "b\nfrom afar")


def test_contradictory_layouts_are_rejected(tmp_path):
    path = written(tmp_path, *GOOD)
    twice = LAYOUT.model_copy(update={"models": LAYOUT.models[:1] * 3})
    message = refusal(read_ratings, path, twice)
    assert has_tokens(message, "models … IL") and has_tokens(message, "column 'rating_IL'")
    without = LAYOUT.model_copy(update={"experience_levels": ()})
    assert "experience_levels" in refusal(read_ratings, path, without)


def test_other_scales_delimiters_and_fewer_questions(tmp_path):
    path = tmp_path / "survey.csv"
    path.write_text("\ufeffwho;x;y;z;best\n1; 7 ;1;4;Y\n2;6;2;4;X\n", encoding="utf-8")
    layout = layout_of(
        {
            "delimiter": ";",
            "participant": "who",
            "models": [{"name": name.upper(), "column": name} for name in "xyz"],
            "scale_points": 7,
            "best": "best",
        }
    )
    ratings = read_ratings(path, layout)
    assert ratings.scores.tolist() == [[7, 1, 4], [6, 2, 4]]
    assert ratings.groups == {}
