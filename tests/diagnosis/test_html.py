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


def test_a_picture_on_several_pages_is_drawn_once():
    widths = []

    def draw(width):
        widths.append(width)
        return small_figure()

    picture = html.Picture("line", draw, "A line.", "a line", {"x": [0, 1]})
    first, second = picture.fragment("figures"), picture.fragment()
    assert widths == [html.WIDE, html.NARROW]
    assert picture.content in first
    assert picture.content in second
    assert ("line.png" in first, "line.png" in second) == (True, False)


def test_ids_of_two_svgs_differ():
    first, second = html.figure(small_figure()), html.figure(small_figure())
    ids = [set(re.findall(r'\bid="([^"]+)"', f)) for f in (first, second)]
    assert ids[0]
    assert not ids[0] & ids[1]
    for fragment, own in zip((first, second), ids, strict=True):
        assert set(re.findall(r'href="#([^"]+)"', fragment)) <= own
        assert set(re.findall(r"url\(#([^)]+)\)", fragment)) <= own


def test_a_figure_s_data_are_what_it_draws(tmp_path):
    """Points by their label and panel, places by names, bars by what they reach; of a photograph none."""
    from matplotlib.figure import Figure

    drawing = Figure()
    left, right = drawing.subplots(1, 2)
    left.plot([0.5, 2.0], [0, 1], label="ours")
    left.set_yticks([0, 1], ["still", "feedback"])
    left.set_xlabel("error [mm]")
    right.bar([0, 1], [3.0, -4.0], label="gain")
    right.scatter([7, 8], [9, 10])
    rows = list(zip(*html.drawn(drawing).values(), strict=True))
    assert rows[:2] == [("error [mm]", "ours", 0.5, "still"), ("error [mm]", "ours", 2.0, "feedback")]
    assert ("panel 2", "", 7.0, 9.0) in rows
    assert ("panel 2", "gain", 0.0, 3.0) in rows
    photograph = Figure()
    photograph.subplots().imshow([[0, 1], [1, 0]])
    assert html.drawn(photograph) == {}
    fragment = html.figure(drawing, "a caption", name="two", beside=tmp_path)
    for name in re.findall(r'href="([^"#]+)"', fragment):
        assert (tmp_path / name).stat().st_size > 30
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {"two.png", "two.csv"}
    assert "figures/" not in html.figure(photograph, "without files")
