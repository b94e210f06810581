"""Can small patches of photographs be told from those of their twins? The AUC of a logistic model on fixed features, split by photograph.

0.5: not told apart; 1: always. The model sees no more than what FEATURES names, of patches of PATCH_PX pixels.
"""

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import mannwhitneyu

PATCH_PX = 32
FEATURES = (
    "mean", "spread", "low", "high", "below_low", "above_high", "residual", "slope", "steepest", "along_x", "along_y",
    "blocks", "red", "blue", "colour_spread",
)  # fmt: skip
PENALTY = 1.0  # of squared weights, of standardised features: against separation without end
TINY = 1e-2  # grey levels


def patches_of(image, inside):
    """Return the patches (n, 32, 32, 3) of an image (H, W, 1 or 3), on a grid from its corner, all of whose pixels are ``inside`` (H, W)."""
    image, p = np.broadcast_to(image, (*image.shape[:2], 3)), PATCH_PX
    rows, columns = (n // p for n in image.shape[:2])
    tiles = image[: rows * p, : columns * p].reshape(rows, p, columns, p, 3).swapaxes(1, 2)
    return tiles[inside[: rows * p, : columns * p].reshape(rows, p, columns, p).all((1, 3))]


def features_of(patches):
    """Return the FEATURES (n, 15) of patches (n, 32, 32, 3) in grey levels."""
    green, flat = patches[..., 1], (1, 2)
    low, high = np.percentile(green, [5, 95], axis=flat)
    mixed = (
        green[:, 1:, 1:] - green[:, 1:, :-1] - green[:, :-1, 1:] + green[:, :-1, :-1]
    )  # no edge along an axis is in it
    slopes = np.hypot(green[:, 1:, 1:] - green[:, 1:, :-1], green[:, 1:, 1:] - green[:, :-1, 1:])
    steps = np.abs(np.diff(green, axis=2)).mean(1)
    at_blocks = np.arange(1, PATCH_PX) % 8 == 0
    red, blue = (patches[..., k] - green for k in (0, 2))

    def along(axis):
        a, b = (np.take(mixed, np.arange(s, mixed.shape[axis] - 1 + s), axis=axis) for s in (0, 1))
        return (a * b).mean(flat) / (mixed.var(flat) + TINY)

    columns = [
        green.mean(flat), green.std(flat), low, high, low - green.min(flat), green.max(flat) - high,
        np.log(np.median(np.abs(mixed), axis=flat) + TINY), np.log(slopes.mean(flat) + TINY),
        np.log(np.percentile(slopes, 95, axis=flat) + TINY), along(2), along(1),
        np.log((steps[:, at_blocks].mean(1) + TINY) / (steps[:, ~at_blocks].mean(1) + TINY)),
        red.mean(flat), blue.mean(flat), np.log(red.std(flat) + TINY),
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def auc(photographs, twins, unseen_photographs, unseen_twins):
    """Return the area under the ROC curve of patches (n, 32, 32, 3) never seen, of a model that was shown the first two."""
    seen, unseen = (
        [features_of(p) for p in pair] for pair in ((photographs, twins), (unseen_photographs, unseen_twins))
    )
    X, y = np.concatenate(seen), np.repeat([1.0, 0.0], [len(p) for p in seen])
    middle, scale = X.mean(0), X.std(0) + 1e-9
    w = _logistic((X - middle) / scale, y)
    scores = [(f - middle) / scale @ w[1:] for f in unseen]
    return float(mannwhitneyu(*scores).statistic / (len(scores[0]) * len(scores[1])))


def _logistic(X, y):
    """Return the weights (1 + features,) of the penalised logistic model of y (n,), 0 or 1, on X (n, features)."""
    X = np.column_stack([np.ones(len(X)), X])

    def loss(w):
        z, held = X @ w, np.r_[0, w[1:]]
        return np.logaddexp(0, z).sum() - y @ z + PENALTY / 2 * held @ held, X.T @ (expit(z) - y) + PENALTY * held

    return minimize(loss, np.zeros(X.shape[1]), jac=True, method="L-BFGS-B").x
