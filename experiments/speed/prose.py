"""The page of words about who wins where, generated from the numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from experiments.speed.results import ERRORS, cheapest, entries


def prose(result: dict) -> list[str]:
    """A page of words about who wins where, generated from the numbers."""
    lines = []
    groups = {
        "irradiance": [e for _, m, e in entries(result) if m == "irradiance"],
        "glossy reflection": [e for _, m, e in entries(result) if m != "irradiance"],
    }
    for what, group in groups.items():
        for error in ERRORS:
            wins = Counter(
                entry["methods"][name]["family"]
                for entry in group
                if (name := cheapest(entry["methods"], error)) is not None
            )
            if not wins:
                lines.append(
                    f"No method of {what} but the sum over every pixel is within "
                    f"{error:.1%} anywhere."
                )
                continue
            none = len(group) - sum(wins.values())
            words = ", ".join(f"{family} ({n})" for family, n in wins.most_common(4))
            rest = f"; none in {none}" if none else ""
            lines.append(
                f"**{what}, error at most {error:.1%}**: the fastest evaluation is that "
                f"of {words} of {len(group)} cases{rest}."
            )
    lines += [_losses(result), *_choices(result), _RARE, _predictions(result)]
    return [line for line in lines if line]


_RARE = (
    "A narrow lobe meets a small sun at few of the orientations that are drawn: there "
    "measured errors scatter widely about the predicted ones, which are expectations."
)


def _losses(result: dict) -> str:
    """Where another method is faster than ours at an error."""
    worst: list[tuple[float, str]] = []
    for panorama, material, entry in entries(result):
        ours = {k: v for k, v in entry["methods"].items() if v["ours"]}
        for error in ERRORS:
            best, own = cheapest(entry["methods"], error), cheapest(ours, error)
            if best is None or entry["methods"][best]["ours"]:
                continue
            rival = entry["methods"][best]["seconds"]
            if own is None:
                words = f"{material} under {panorama} at {error:.1%}: only {best}"
                worst.append((np.inf, words))
                continue
            ratio = entry["methods"][own]["seconds"] / rival
            words = (
                f"{material} under {panorama} at {error:.1%}: {best} takes 1/{ratio:.1f} "
                f"of the time of {own}"
            )
            worst.append((ratio, words))
    if not worst:
        return "No other method is faster than shjax's at any of these errors."
    worst.sort(key=lambda pair: -pair[0])
    shown = "; ".join(words for _, words in worst)
    return f"**Where ours lose** ({len(worst)} cases), the largest first: {shown}."


def _choices(result: dict) -> Iterator[str]:
    """What choose_model picked, and whether something cheaper was as good."""
    for error in (0.3, 0.1, 0.03):
        name = f"choose_model {error:g}"
        measured, beaten, off, count = [], Counter(), Counter(), 0
        for panorama, material, entry in entries(result):
            row = entry["methods"].get(name)
            if material == "irradiance" or row is None:
                continue
            count += 1
            measured.append(row["rms"])
            limit = max(error, row["predicted"]) + entry["reference's own error"]
            limit += 3 * row["standard error"]
            off[f"{material} under {panorama}"] = row["rms"] / limit
            best = cheapest(entry["methods"], row["rms"] * (1 + 1e-9))
            if best not in (None, name):
                beaten[entry["methods"][best]["family"]] += 1
        if not count:
            continue
        words = ", ".join(f"{family} in {n}" for family, n in beaten.most_common(3))
        faster = f"faster at no more error: {words}" if words else "nothing was faster"
        above = [name for name, ratio in off.most_common() if ratio > 1]
        which = f" ({', '.join(above[:6])})" if above else ""
        yield (
            f"**choose_model** asked for {error:g}: measured {np.median(measured):.3f} in "
            f"the median, {max(measured):.3f} at most; {len(above)} of {count} above what "
            f"was asked or predicted by more than three standard errors and the "
            f"reference's own{which}; {faster}."
        )


def _predictions(result: dict) -> str:
    ratios = [
        row["rms"] / row["predicted"]
        for _, material, entry in entries(result)
        for row in entry["methods"].values()
        if row.get("predicted", 0) > 3 * entry["reference's own error"]
        and row["family"] in ("SHRM", "radial maps")
    ]
    if not ratios:
        return ""
    low, mid, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    return (
        "**Predicted and measured**: over all maps whose predicted error is above three "
        f"times the reference's own, measured over predicted is {mid:.2f} in the median, "
        f"{low:.2f} to {high:.2f} for nine in ten ({len(ratios)} maps)."
    )


def full_size(result: dict) -> str:
    """Errors under the whole panorama beside those under the averaged one."""
    found = result.get("full size")
    if not found:
        return "Not measured in this run."
    rows = ", ".join(
        f"{name} {row['small']:.3f} and {row['full']:.3f}"
        for name, row in found["methods"].items()
    )
    return (
        f"{found['panorama']} at {found['columns']} x {found['rows']}, "
        f"{found['material']}, {found['pairs']} orientations: errors with the averaged "
        f"and with the whole panorama: {rows}."
    )
