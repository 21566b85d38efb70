"""The tables, as Markdown."""
import targets

TIMES = ("median_ms", "cpu_ms")


def number(value):
    """Three digits, as a table needs."""
    if value is None:
        return "–"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def cell(entry):
    if entry["error"]:
        return "failed"
    if entry["measures"] != "turn":
        return "–"
    if entry["median"].get("is_black"):
        return "black picture"
    return " / ".join(number(entry["median"].get(key)) for key in TIMES)


def first(median):
    """The first frame; of a run for the first whole picture, that."""
    whole = median.get("first_whole_ms")
    return number(median.get("first_ms")) if whole is None else f"{number(whole)} (whole)"


def times(results):
    """ms per frame of all programs: one table per row, ours last, with the ratios."""
    out = []
    for row, programs in results.items():
        ours = [id for id, entry in programs.items() if entry["is_ours"] and entry["measures"] == "turn"]
        head = [row, "ms per frame: wall / cpu", "first frame ms", "peak RSS MiB", "Msamples taken, contributing",
                *(f"cpu (wall) ÷ {programs[id]['label']}" for id in ours)]
        lines = []
        for id, entry in programs.items():
            # What else is measured has its place among the targets.
            if entry["measures"] not in ("turn", "first"):
                continue
            median = entry["median"] or {}
            samples = [median.get(key) for key in ("samples", "samples_contributing")]
            line = [entry["label"], cell(entry), first(median), number(median.get("rss_peak_mib")),
                    ", ".join(number(None if s is None else s / 1e6) for s in samples) if entry["is_ours"] else "–"]
            for device in ours:
                cpu = targets.ratio(results, row, id, device)
                wall = targets.ratio(results, row, id, device, "median_ms")
                line.append("–" if cpu is None or entry["measures"] != "turn" else f"{number(cpu)} ({number(wall)})")
            lines.append(line)
        out.append(table(head, lines))
    return "\n\n".join(out)


def target_table(checked, devices):
    rows = []
    for target in checked:
        line = [target["what"], target["wanted"]]
        for device in devices:
            found = target["by_device"][device]
            verdict = {None: "", True: " met", False: " **missed**"}[found["met"]]
            line.append(f"{number(found['value'])}{verdict}")
        rows.append(line)
    return table(["target", "wanted", *devices], rows)


def picture_table(pictures):
    return table(
        ["picture", "ours", "beside", "mean ×255", "max ×255", "off by > 8/255", "pixels"],
        [[row, pair["ours"], pair["other"], f"{pair['mean']:.2f}", str(pair["max"]), f"{pair['off']:.2%}",
          str(pair["pixels"])] for row, pairs in pictures.items() for pair in pairs])


def markdown(report):
    """The whole report."""
    devices = report["devices"]
    parts = [
        f"# Beside the peers · {report['date']}",
        f"{report['machine']}. Versions: {', '.join(report['versions'])}. {report['frames']} frames a turn, {report['rounds']} "
        "rounds, medians. Load average at the beginning and the end: "
        f"{' and '.join(f'{load:.1f}' for load in report['load'])}.",
        f"`{report['command']}`",
        "A ratio is the program's process-CPU ms ÷ ours, in brackets wall ms ÷ ours: above 1 we are faster. First frame: the "
        "peers' volume is in memory then; ours is from the start of the process. What the columns mean and what differs by "
        "design: README.md.",
        "## Times", times(report["results"]),
        "## Targets",
        "Ratios are of process-CPU ms; – where a row was not in this run.",
        target_table(report["targets"], devices),
    ]
    if report["pictures"]:
        parts += ["## Pictures", picture_table(report["pictures"])]
    if report["failures"]:
        parts += ["## Failed", "\n\n".join(f"{where}\n```\n{why}\n```" for where, why in report["failures"])]
    return "\n\n".join(parts) + "\n"
