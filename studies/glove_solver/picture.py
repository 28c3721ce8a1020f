"""The work-precision diagram."""

import numpy as np
from matplotlib.figure import Figure

STYLES = {
    "ours": "o-",
    "ours, fixed steps": "o:",
    "explicit Euler": "v--",
    "RK45": "^--",
    "BDF": "s-",
    "Radau": "D-",
}


def diagram(rows: list[dict]) -> Figure:
    """A panel per scene: error against seconds, a line per method; a method that gave up stands at the upper edge."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure = Figure(figsize=(15, 13), layout="constrained")
    panels = figure.subplots(-(-len(scenes) // 3), 3, squeeze=False).ravel()
    for panel in panels[len(scenes) :]:
        panel.axis("off")
    for panel, scene in zip(panels, scenes, strict=False):
        own = [row for row in rows if row["scene"] == scene]
        panel.set(xscale="log", yscale="log", xlabel="seconds", ylabel="relative error of the forces", ylim=(1e-6, 1e2))
        title = f"lambda h = {float(scene):.0e}" if "record" not in scene else f"{scene}, one grasp each"
        panel.set_title(title)
        panel.axhline(1e-2, color="0.8", lw=1)
        for color, (method, style) in enumerate(STYLES.items()):
            found = [row for row in own if row["method"] == method]
            good = [row for row in found if np.isfinite(row["error"])]
            if good:
                seconds, errors = ([row[name] for row in good] for name in ("seconds", "error"))
                panel.plot(seconds, np.clip(errors, 1e-6, 1e2), style, color=f"C{color}", label=method)
            lost = [row["seconds"] for row in found if not np.isfinite(row["error"])]
            if lost:
                panel.plot(lost, [6e1] * len(lost), "x", color=f"C{color}", label=None if good else f"{method}: lost")
        panel.legend(fontsize=7)
    figure.suptitle("Virtual glove: error of the sensors' forces against run time; x: blew up or gave up; grey: 1 %")
    return figure
