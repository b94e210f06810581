"""Draw the pictures of docs/method.md from a run: `make picture`.

One file for each of PICTURES, from verdicts, ladders, plates' gaps and observations of a run; nothing is fitted.
"""

import json
import sys
from pathlib import Path

import figures
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import seaborn as sns
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from case_files import load_case, load_observations
from effects import library
from gap.bounds import CERTAIN, CHARGE, MAX_FLOOR_GAP, MAX_PARAMETERS, MIN_GAIN, TWICE
from gap.explain.where import BINS
from gap.fit.residuals import NU, Whitener, rho
from gap.observables import FEATURES, GAP_GROUPS

MIN_SHOWN = 0.05  # a parameter may end at its null, which no logarithm shows
SIZE_IN, DPI = (8, 3.3), 90
TWINS = {"configured": ("as configured", figures.ORANGE), "explained": ("with what was found", figures.BLUE)}
WHERE = "ground", "image_radius"  # the observable and the covariate that are shown


def read_verdicts(results):
    """Return {camera: what the result file says} of all cameras that were diagnosed."""
    found = [json.loads(path.read_text()) for path in sorted((results / "diagnosis").glob("*.json"))]
    return {d["camera"]: d for d in found if not d.get("why")}


def read_plates(results, camera):
    """Return the table of plates' gaps of a camera's first and last twin."""
    return pd.read_parquet(results / f"diagnosis/{camera}/plates.parquet")


def whitened(results, camera):
    """Return {twin: whitened residuals (n,)} of plates' features, over all captures that were compared."""
    case, _ = load_case(results / "expand" / camera, results / f"register/{camera}.json", camera)
    load_observations(results / f"diagnosis/{camera}/observations.npz", case)
    capture_of = {c.view.capture: c for c in case.captures}
    index = {plate.name: k for k, plate in enumerate(case.scene.plates)}
    out = {twin: [] for twin in TWINS}
    for (twin, capture), rows in read_plates(results, camera).groupby(["twin", "capture"]):
        w = Whitener(capture_of[capture], with_noise=False, n_pose=len(case.sigma_pose))
        at = np.searchsorted(w.plates, [index[name] for name in rows["plate"]])
        out[twin].append(np.einsum("pij,pj->pi", w.lower_inverse[at], rows[list(FEATURES)].to_numpy()).ravel())
    return {twin: np.concatenate(parts) for twin, parts in out.items()}


def draw_loss(results, camera):
    """Return a figure: the loss of a residual, and how large residuals are before and after."""
    figure, (left, right) = plt.subplots(1, 2, figsize=SIZE_IN)
    y = np.geomspace(0.1, 300, 200)
    left.loglog(y, y**2, "--", color=figures.GREY, label="$y^2$")
    left.loglog(y, rho(y), color=figures.BLUE, label=rf"$\rho(y)$, $\nu = {NU:g}$")
    left.loglog(y, rho(y, NU * 30**2), ":", color=figures.BLUE, label=r"30 times as wide, $\nu = 8\cdot 30^2$")
    left.set(xlabel="$|y|$, standard deviations", title="loss of one residual")
    left.legend(fontsize=8)
    for twin, residuals in whitened(results, camera).items():
        label, colour = TWINS[twin]
        sns.ecdfplot(np.maximum(np.abs(residuals), 1e-2), ax=right, color=colour, label=label, complementary=True)
    normal = np.abs(np.random.default_rng(0).standard_normal(100_000))
    sns.ecdfplot(normal, ax=right, color=figures.GREY, ls="--", label="noise alone", complementary=True)
    right.set(
        xscale="log", xlim=(0.1, 300), xlabel="$|y|$", ylabel="", title=f"{camera}: share of residuals above $|y|$"
    )
    right.legend(fontsize=8, loc="upper right")
    return figure


def named_parameters(verdicts):
    """Return a table of the parameters that were named: how far from their null, in standard errors and in ``matters``."""
    rows = []
    for camera, diagnosis in verdicts.items():
        for step in diagnosis["steps"]:
            acting = {k: p for k, p in library.parameters_of(step["effect"]).items() if not p.auxiliary}
            if len(acting) > MAX_PARAMETERS:  # waves of a free warp count together
                continue
            for name, p in acting.items():
                value, error = (step["parameters"][name][key] for key in ("value", "se"))
                away = abs(value - p.null)
                if error:
                    rows.append((camera, step["effect"], name, away / p.matters, away / error))
    return pd.DataFrame(rows, columns=["camera", "effect", "parameter", "size", "evidence"])


def draw_evidence(results, camera):
    """Return a figure: how certain the named parameters are, against how large they are."""
    table = named_parameters(read_verdicts(results))
    figure, axis = plt.subplots(figsize=SIZE_IN)
    table["effect"] = table.effect.str.replace("_", " ")
    numbers = ["size", "evidence"]
    table[numbers] = table[numbers].clip(lower=MIN_SHOWN)
    sns.scatterplot(table, x="size", y="evidence", hue="effect", style="camera", palette="colorblind", ax=axis, s=45)
    best = table.evidence == table.groupby("effect").evidence.transform("max")
    heights = np.where(np.cumsum(best) % 2, 3, -8)
    for row, right, up in zip(table.itertuples(), best, heights, strict=True):  # so that names stay apart
        place, side = ((6, up), "left") if right else ((-6, -5), "right")  # each effect's best on the right
        axis.annotate(row.parameter, (row.size, row.evidence), place, textcoords="offset points", ha=side, fontsize=7)
    axis.set(xscale="log", yscale="log", xlabel=r"size: $|\theta - \theta_0|\,/$ matters")
    axis.set_ylabel(r"certainty: $|\theta - \theta_0|\,/$ standard error")
    axis.set_xlim(min(0.3, table["size"].min() / 4), 12 * table["size"].max())
    axis.set_ylim(min(0.3, table["evidence"].min() / 2), 3 * table["evidence"].max())
    (_, right), (_, top) = axis.get_xlim(), axis.get_ylim()
    axis.fill_between([1, right], CERTAIN, top, color=figures.GREEN, alpha=0.1, lw=0)
    axis.text(right / 1.1, CERTAIN * 1.3, "one parameter here is enough", fontsize=8, color=figures.GREEN, ha="right")
    axis.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=8)
    axis.set_title("parameters of the effects that were named")
    return figure


def draw_effect_size(results, camera):
    """Return a figure: the held-out gains of each camera's first candidates with two standard errors, and the least gain."""
    verdicts = read_verdicts(results)
    figure, all_axes = plt.subplots(1, len(verdicts), figsize=SIZE_IN, sharex=True, squeeze=False)
    for axis, (name, diagnosis) in zip(all_axes[0], verdicts.items(), strict=True):
        gaining = [c for c in diagnosis["candidates"] if c["gain"] > 1]
        rows = pd.DataFrame(gaining, columns=["effect", "gain", "gain_se", "parameters"])[::-1]
        at, gains = np.arange(len(rows)), rows.gain.to_numpy()
        low = np.minimum(2 * rows.gain_se.to_numpy(), gains - 1)
        axis.errorbar(gains, at, xerr=[low, 2 * rows.gain_se], fmt="o", color=figures.BLUE, capsize=2)
        least = [MIN_GAIN + CHARGE * len(p) for p in rows.parameters]
        axis.plot(least, at, "|", color=figures.ORANGE, ms=14, mew=2)
        axis.set_yticks(at, [e.replace("_", "\n", 1).replace("_", " ") for e in rows.effect], fontsize=7)
        axis.set_ylim(-0.7, len(rows) - 0.3)
        axis.set(xscale="log", title=name)
        axis.set_xticks([1, 100, 1e4])
    all_axes[0][len(verdicts) // 2].set_xlabel("gain in loss on held-out captures, ± 2 standard errors (orange: least)")
    return figure


def draw_verdict(results, camera):
    """Return a figure: gaps falling step by step, and what is left in each group of observables."""
    verdicts = read_verdicts(results)
    figure, (left, right) = plt.subplots(1, 2, figsize=SIZE_IN, width_ratios=[1, 1.1])
    for colour, name in zip(sns.color_palette("colorblind", len(verdicts)), verdicts, strict=True):
        ladder = pd.read_csv(results / f"diagnosis/{name}/ladder.csv")
        left.fill_between(ladder.step, ladder.gap_low, ladder.gap_high, color=colour, alpha=0.2, lw=0)
        left.plot(ladder.step, ladder.gap, "o-", color=colour, label=f"{name}: {verdicts[name]['verdict']}")
    left.axhspan(0.5, MAX_FLOOR_GAP, color=figures.GREEN, alpha=0.12, lw=0)
    left.axhline(TWICE, color=figures.GREY, ls="--")
    left.set(yscale="log", xlabel="effects added", title="gap, floors", ylim=(0.5, None))
    left.set_xticks(range(1 + max(len(d["steps"]) for d in verdicts.values())))
    left.set_yticks([1, 2, 5])
    left.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    left.yaxis.set_minor_formatter(NullFormatter())
    left.legend(fontsize=8)
    groups = pd.DataFrame({name: d["groups"] for name, d in verdicts.items()}).T.reindex(columns=GAP_GROUPS)
    sns.heatmap(groups, ax=right, annot=True, fmt=".2f", cmap="RdYlBu_r", center=MAX_FLOOR_GAP, cbar=False)
    right.tick_params(rotation=0, labelsize=8)
    right.set_title("what is left, by group")
    return figure


def draw_where(results, camera):
    """Return a figure: the gap of one observable against one covariate, on fitted captures and on the held-out ones."""
    plates, (observable, covariate) = read_plates(results, camera), WHERE
    entry = next(
        (w for w in read_verdicts(results)[camera]["where"] if (w["observable"], w["covariate"]) == WHERE), None
    )
    figure, axis = plt.subplots(figsize=SIZE_IN)
    for twin, (label, colour) in TWINS.items():
        mine = plates[(plates.twin == twin) & ~plates.fitted]
        axis.scatter(mine[covariate], mine[observable], s=8, color=colour, label=f"held out, twin {label}")
    fitted = plates[(plates.twin == "configured") & plates.fitted]
    edges = plates[covariate].quantile(np.linspace(0, 1, BINS + 1)).to_numpy()
    means = fitted.groupby(np.digitize(fitted[covariate], edges[1:-1]))[observable].mean()
    axis.stairs(means.reindex(range(BINS)), edges, baseline=None, color="black", lw=2, label="means of fitted captures")
    axis.axhline(0, color=figures.GREY, ls="--")
    axis.set(xlabel=covariate, ylabel=f"{observable}, grey levels")
    share = f": {100 * entry['share']:.0f} % predicted" if entry else ""
    axis.set_title(f"{camera}: capture minus twin{share}")
    axis.legend(fontsize=8)
    return figure


PICTURES = {
    "loss": draw_loss,
    "evidence": draw_evidence,
    "effect_size": draw_effect_size,
    "verdict": draw_verdict,
    "where": draw_where,
}


def draw_all(results, camera, folder):
    """Write a PNG of each of PICTURES into a folder; ``camera`` is shown where only one is."""
    results, folder = Path(results), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        figure = draw(results, camera)
        figure.savefig(folder / f"{name}.png", dpi=DPI, metadata={"Software": None})
        plt.close(figure)


if __name__ == "__main__":
    plt.switch_backend("agg")
    draw_all(*sys.argv[1:4])
