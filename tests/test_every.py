"""Cases that are checked in one test."""

import pytest


@pytest.mark.xfail(raises=ExceptionGroup, strict=True)
@pytest.mark.every("number", [1, 2, 3])
def test_a_case_that_fails_fails_the_test(number):
    assert number != 2
