"""The sources have the syntax of Python 3.10 to 3.13, and import nothing that these have removed.

Only the standard library's newest parts in use (`StrEnum`, `Self`) need 3.11.
"""

from __future__ import annotations

import ast
import warnings

from support.source import SourceFile, source_files

FILES = source_files()
#: Modules of the standard library that Python 3.12 and 3.13 no longer have.
REMOVED = {
    *("aifc", "asynchat", "asyncore", "audioop", "cgi", "cgitb", "chunk", "crypt", "distutils", "imghdr", "imp"),
    *("lib2to3", "mailcap", "msilib", "nis", "nntplib", "ossaudiodev", "pipes", "smtpd", "sndhdr", "spwd", "sunau"),
    *("telnetlib", "uu", "xdrlib"),
}


def test_syntax_is_that_of_python_3_10() -> None:
    assert not [problem for file in FILES if (problem := syntax_problem(file))]


def test_no_module_is_imported_that_newer_versions_lack() -> None:
    imports = [(file, line, name) for file in FILES for line, name in file.imports()]
    assert len(imports) > 1000
    assert not [f"{file}:{line}: {name}" for file, line, name in imports if name.partition(".")[0] in REMOVED]


def test_newer_syntax_would_be_found() -> None:
    source = "try:\n    pass\nexcept* OSError:\n    pass\n"
    assert ast.parse(source)
    assert problem_of(source, "new.py").startswith("new.py")
    assert "escape" in problem_of('"\\d"', "escape.py")


def syntax_problem(file: SourceFile) -> str:
    return problem_of(file.text, str(file))


def problem_of(source: str, name: str) -> str:
    """Why Python 3.10 refuses a source, or 3.12 warns of it; "" if they accept it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # an invalid escape sequence
            ast.parse(source, name, feature_version=(3, 10))
    except (SyntaxError, Warning) as error:
        return f"{name}: {error}"
    return ""
