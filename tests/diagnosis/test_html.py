import re

import matplotlib as mpl

from fieldmodels import html

mpl.use("Agg")


def small_figure():
    from matplotlib import pyplot as plt

    drawing, axes = plt.subplots()
    axes.plot([0, 1], [0, 1])
    axes.axhspan(0.2, 0.4, hatch="/")
    return drawing


def test_page_needs_nothing_from_outside():
    body = html.figure(small_figure(), "a < b") + html.table(["name", "value"], [["<b>", 1.5]])
    result = html.page("x & y", body)
    assert not re.search(r'(src|href)="https?:', result)
    assert "x &amp; y" in result
    assert "a &lt; b" in result
    assert "&lt;b&gt;" in result
    assert '<td class="number">1.5</td>' in result


def test_ids_of_two_svgs_differ():
    first, second = html.figure(small_figure()), html.figure(small_figure())
    ids = [set(re.findall(r'\bid="([^"]+)"', f)) for f in (first, second)]
    assert ids[0]
    assert not ids[0] & ids[1]
    for fragment, own in zip((first, second), ids, strict=True):
        assert set(re.findall(r'href="#([^"]+)"', fragment)) <= own
        assert set(re.findall(r"url\(#([^)]+)\)", fragment)) <= own
