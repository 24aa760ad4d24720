"""What tests share is made once, stays as it was made, and belongs to the code that made it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from support import products
from support.products import cache_of_this_code, made_once


def test_of_two_that_ask_at_once_one_makes_it(tmp_path: Path) -> None:
    made: list[Path] = []

    def make(folder: Path) -> None:
        made.append(folder)
        (folder / "result").write_text("first")

    def ask(_: int) -> str:
        with made_once(tmp_path, "job", make) as product:
            return (product / "result").read_text()

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(ask, range(2))) == ["first", "first"]
    assert len(made) == 1


def test_half_a_product_is_made_again(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "half").touch()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), made_once(tmp_path, "job", fails):
        pass
    with made_once(tmp_path, "job", lambda folder: (folder / "whole").touch()) as product:
        assert [path.name for path in product.iterdir()] == ["whole"]


def test_a_changed_product_is_an_error(tmp_path: Path) -> None:
    with (
        pytest.raises(AssertionError, match="a test changed what all tests share"),
        made_once(tmp_path, "job", lambda folder: (folder / "result").touch()) as product,
    ):
        (product / "result").write_text("other")


def test_other_code_has_another_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "python" / "ecm" / "rig" / "elastic.py"
    source.parent.mkdir(parents=True)
    monkeypatch.setattr(products, "ROOT", tmp_path)
    source.write_text("a = 1\n")
    before = cache_of_this_code()
    assert cache_of_this_code() == before
    source.write_text("a = 2\n")
    assert cache_of_this_code() != before
