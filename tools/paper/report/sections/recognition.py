# SPDX-License-Identifier: Apache-2.0
"""Fig. 6: place recognition."""

import math

from charts import Bar, BarChart
from estimates import Estimate, fixed, text_of
from inputs import number
from published import RECOGNITION_SHARES
from study import Study


def recognised(study: Study) -> dict[tuple[str, str, str], tuple[Estimate, float]]:
    """Returns the AUC and recall@1 by representation, method and query; an AUC of no queries where it failed."""
    found = {}
    for case in study.data["cases"]:
        outcome = study.inputs.outcome(case["unit"])
        found[case["representation"], case["method"], case["query"]] = (
            Estimate.of(outcome, "auc", "auc_low", "auc_high", "queries"),
            number(outcome["recall"]) if outcome else math.nan)
    return found


def render(study: Study) -> None:
    data, recordings, page, found = study.data, study.recordings, study.page, recognised(study)
    page.text(
        f"Area under precision over recall (AUC) of single frames: which frame of '{recordings.train}' shows the same "
        f"place as a frame of another traversal, right within {data['tolerance']} frames, of {recordings.frames} "
        "frames. 'mlp' is the paper's classifier, one multi-layer perceptron trained on the reference; 'nearest' is "
        "the nearest frame by cosine. In the paper the AUC falls with the dimension, halves from summer to winter and "
        "falls below a quarter from day to night.")
    rows = []
    for method in data["methods"]:
        chart = BarChart(f"Area under the precision-recall curve, {method}", "AUC", data["representations"])
        for query in data["queries"]:
            for representation in data["representations"]:
                auc, recall = found[representation, method, query]
                chart.groups.setdefault(query, []).append(Bar(auc.mean, auc.low, auc.high))
                if auc.n:
                    rows.append([representation, method, query, recordings.conditions[query], str(auc.n),
                                 text_of(auc, 3), fixed(recall, 3)])
        page.bars(f"figure-6-{method}", chart, f"{chart.title}.")
    page.table("figure-6", "95 % intervals by resampling blocks of neighbouring frames.",
               ["representation", "method", "query", "condition", "queries", "AUC", "recall@1"], rows)
    aucs = {representation: {query: found[representation, data["methods"][0], query][0].mean
                             for query in data["queries"]} for representation in data["representations"]}
    compare_conditions(study, aucs)
    compare_dimensions(study, aucs)


def compare_conditions(study: Study, aucs: dict[str, dict[str, float]]) -> None:
    """The paper gives no figures that stand alone, but how they fall."""
    rows = []
    for representation, by_query in aucs.items():
        best = max((auc for auc in by_query.values() if math.isfinite(auc)), default=math.nan)
        for query, auc in by_query.items():
            share = auc / best if len(by_query) > 1 and best > 0 else math.nan
            paper, text = RECOGNITION_SHARES.get(study.recordings.conditions[query], (math.nan, "-"))
            rows.append([representation, query, fixed(auc, 3), fixed(share, 2), text])
            if share < paper:
                study.page.remark(f"Worse than the paper: by {representation}, '{query}' keeps {fixed(share, 2)} of "
                                  f"the AUC of the condition that is recognised best, in the paper {text}.")
    study.page.table("figure-6-falls",
                     "How the AUC of the paper's classifier falls: of each condition, as a share of the best other "
                     "condition's, for each representation (none if there is one condition only). The paper: half from "
                     "summer to winter, below a quarter from day to night.",
                     ["representation", "query", "AUC", "share of the best", "paper"], rows)


def compare_dimensions(study: Study, aucs: dict[str, dict[str, float]]) -> None:
    names = list(aucs)
    for narrow, wide in zip(names, names[1:]):
        if narrow.rpartition("-")[0] != wide.rpartition("-")[0]:
            continue
        before, after = (sum(aucs[name].values()) / len(aucs[name]) for name in (narrow, wide))
        if after > before:
            study.page.remark("Unlike in the paper, the AUC does not fall with the dimension: mean over conditions "
                              f"{fixed(before, 3)} by {narrow}, {fixed(after, 3)} by {wide}.")
