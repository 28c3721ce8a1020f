"""The work-precision diagram."""

import numpy as np
from matplotlib.figure import Figure

STYLES = {"ours": "o-", "ours, fixed steps": "o:", "explicit Euler": "v--", "RK45": "^--", "BDF": "s-", "Radau": "D-"}
LOWEST, HIGHEST, FAILED = 1e-6, 1e2, 60.0  # errors at the axis' ends, and where a failed run is drawn


def diagram(rows: list[dict]) -> Figure:
    """Error against seconds: a panel for each scene, a line for each method; crosses at the top are failed runs."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    columns, lines = min(3, len(scenes)), -(-len(scenes) // 3)
    figure = Figure(figsize=(5 * columns, 4.3 * lines), dpi=110, layout="constrained")
    for number, scene in enumerate(scenes, 1):
        panel = figure.add_subplot(lines, columns, number, xscale="log", yscale="log", ylim=(LOWEST, HIGHEST))
        panel.set(xlabel="seconds", ylabel="relative error")
        panel.set_title(f"{scene}, one grasp each" if "record" in scene else f"lambda h = {float(scene):.0e}")
        panel.axhline(1e-2, color="0.8", lw=1)
        for color, (method, style) in enumerate(STYLES.items()):
            runs = [row for row in rows if (row["scene"], row["method"]) == (scene, method)]
            if not runs:
                continue
            seconds, error = np.array([(row["seconds"], row["error"]) for row in runs]).T
            failed = np.isnan(error)
            good, crosses = np.clip(error[~failed], LOWEST, HIGHEST), np.full(failed.sum(), FAILED)
            labels = (None, f"{method}: failed") if failed.all() else (method, None)
            panel.plot(seconds[~failed], good, style, color=f"C{color}", label=labels[0])
            panel.plot(seconds[failed], crosses, "x", color=f"C{color}", label=labels[1])
        panel.legend(fontsize=7)
    figure.suptitle("Error of the sensors' forces against run time\nx: diverged or gave up; grey line: 1 %")
    return figure
