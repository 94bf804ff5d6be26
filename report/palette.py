"""The style of each broad phase, the same in every figure.

Bullet's own are dotted or dashed. The colours differ in lightness too, so that readers with a colour vision deficiency can tell
them apart.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from report.study import Series, Study


@dataclass(frozen=True)
class Style:
    """Colour, for light and dark backgrounds; dash and marker, as plotly.js names them."""

    colour: str
    dash: str
    marker: str


STYLES = {
    "bullet-bf": Style("#6d7280", "dot", "circle-open"),
    "bullet-sap": Style("#d9a400", "dash", "square-open"),
    "bullet-bvh": Style("#a8401c", "dashdot", "diamond-open"),
    "gpu-bf": Style("#0e8f63", "solid", "triangle-up"),
    "brute-force": Style("#1f57dd", "solid", "square"),
    "tiles": Style("#a77af0", "solid", "diamond"),
    "auto": Style("#ee2a96", "solid", "circle"),
    "auto+culling": Style("#1cb2dc", "solid", "circle-open"),
}
OTHERS = ("#7d8f1d", "#5f7fa3", "#a86b4c", "#3a9fb0")
DEVICE_DASHES = ("solid", "dashdot", "longdash", "dot")


def styles_of(study: Study) -> dict[Series, Style]:
    """One style per series; further devices of a broad phase get another dash."""
    styles: dict[Series, Style] = {}
    unknown: list[str] = []
    for series in study.series:
        name = series.broadphase
        if name in STYLES:
            style = STYLES[name]
        else:
            if name not in unknown:
                unknown.append(name)
            style = Style(OTHERS[unknown.index(name) % len(OTHERS)], "solid", "cross")
        nth = sum(s.broadphase == name for s in styles)
        if nth > 0:
            style = Style(style.colour, DEVICE_DASHES[nth % len(DEVICE_DASHES)], style.marker)
        styles[series] = style
    return styles


def style_json(style: Style) -> dict[str, str]:
    """As the page's scripts read it."""
    return asdict(style)
