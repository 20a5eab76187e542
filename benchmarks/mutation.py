"""Mutation testing: which small faults in tasks, constraints, controllers, QPs and inertia survive?

A random sample of the faults that `mutation_places` lists is put in, one by one, and the tests that
call the function at fault are run until one fails: first those that found a fault there, then the
quickest. A test that also fails without a fault is not counted.

    python -m benchmarks.mutation [--faults 300] [--seed 1] [--only qp/kkt.py] [--fresh]

Every surviving fault is a line `FILE:LINE: [verdict] fault: text of the line`. An interrupted run
continues: results are kept in benchmarks/results/mutation_SEED.json, with the functions that each
test calls. A changed file is tried again; ``--fresh`` is needed if sources call each other
differently than before.
"""

import argparse
import importlib
import os
import random
from collections import Counter
from typing import Any

from scipy.stats import binomtest

from benchmarks.mutation_places import ROOT, Fault, faults
from benchmarks.mutation_trials import Trials, forked, tried_afresh

RESULTS = ROOT / "benchmarks" / "results"
NOTICED = ("killed", "endless")
# Faults without an observable effect: file, line's text, fault -> why.
EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        "wbc/qp/proxqp_workspace.py",
        "return 2.0 ** math.ceil(-math.log2(most)) if 1e-12 < most < 1.0 else 1.0",
        "Lt -> LtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/qp/conflict.py",
        'upper = "upper" if signs[k] > 0.0 else "lower"',
        "Gt -> GtE",
    ): "weights of 0 are left out before",
    (
        "wbc/qp/conflict.py",
        "ends = np.where(weights > 0.0, upper, -lower)",
        "Gt -> GtE",
    ): "weights of 0 are left out behind",
    (
        "wbc/controllers/braking.py",
        'lengths = np.sqrt(np.einsum("ij,ij->i", A, A) + TINY)',
        "Add -> Sub",
    ): "1e-300 beside the square of a length",
    (
        "wbc/controllers/singular.py",
        "return NullSpace(np.zeros((root.size, 0)), np.zeros(root.size), root)",
        "0 -> 1",
    ): "a basis vector of zeros",
    (
        "wbc/controllers/core_memory.py",
        'self._put("scratch", np.zeros(scratch))',
        "zeros -> ones",
    ): "numbers that are written before they are read",
    (
        "wbc/controllers/core_memory.py",
        "looking = self.held + 2 * (n + self.k) + m + 5 if self.struct.closing else 0",
        "0 -> 1",
    ): "room for one number more",
    (
        "wbc/controllers/core_memory.py",
        "begin = np.zeros(6, dtype=np.int64)",
        "zeros -> ones",
    ): "numbers that the core writes",
    ("wbc/qp/core.py", "found = np.empty(3 + qp.g.size)", "3 -> 4"): "room for one number more",
    (
        "wbc/tasks/core_task.py",
        "_LAW = np.zeros(lib.WEIGHTS)  # the numbers of a law, which rows do not depend on",
        "zeros -> ones",
    ): "as it says",
    (
        "wbc/tasks/core_task.py",
        '"scratch": np.empty(moving * (tree.frame_size + 6)),',
        "6 -> 7",
    ): "room for some numbers more",
    (
        "wbc/controllers/outcome.py",
        "if excess.item(worst) <= TOLERANCE:  # NaN is not",
        "LtE -> Lt",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/qp/proxqp_workspace.py",
        "P, g = (qp.P, qp.g) if self.scale == 1.0 else (self.scale * qp.P, self.scale * qp.g)",
        "1.0 -> 2.001",
    ): "products with 1",
    (
        "wbc/controllers/core_memory.py",
        "self._planned.largest * (n + 4) + tree.nv * (tree.nv + 16), 13 * tree.joints + 17 * n",
        "13 -> 14",
    ): "room for some numbers more",
    (
        "wbc/controllers/core_memory.py",
        'arrays["moments"] = np.zeros(planned.moments * (n - nv))',
        "zeros -> ones",
    ): "numbers that each tick writes",
    (
        "wbc/qp/kkt.py",
        "return primal <= eps and dual <= eps and complementarity <= eps",
        "LtE -> Lt",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/tasks/placement.py",
        "if np.abs(values[3] - (0.0, 0.0, 0.0, 1.0)).max() > 1e-9:",
        "Gt -> GtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/controllers/controller.py",
        "return self.deadline is not None and perf_counter() - start_time > self.deadline",
        "Gt -> GtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/qp/conflict.py",
        "np.append(np.zeros(n), 1.0),",
        "1.0 -> 2.001",
    ): "what is maximised, in another unit",
    (
        "wbc/tasks/validation.py",
        "if type(found) is Residual:",
        "Is -> IsNot",
    ): "the checks behind find the same, slower",
    (
        "wbc/constraints/rows.py",
        "demanded = float(np.abs(b).max(initial=0.0))",
        "0.0 -> 0.001",
    ): "contacts at rest get an interior that is larger by 0.1 mm/s",
    (
        "wbc/qp/least_infeasible.py",
        "found = np.flatnonzero(np.abs(missed) > _MET * (1.0 + largest(x)))",
        "Gt -> GtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/qp/least_infeasible.py",
        "u=qp.u + np.where(above > 0.0, above + margin, 0.0),",
        "Gt -> GtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/controllers/core_plan.py",
        "if not isinstance(backend, ActiveSet | ProxQP) or backend.eps > TOLERANCE:",
        "Gt -> GtE",
    ): "at the one number where it differs nothing depends on it",
    (
        "wbc/controllers/relaxation.py",
        "own = np.broadcast_to(weight, bounds.lower.shape)",
        "lower -> upper",
    ): "both have the same shape",
    (
        "wbc/qp/core.py",
        "wanted = np.empty(3, dtype=np.int64)",
        "3 -> 4",
    ): "room for one number more",
    (
        "wbc/controllers/core_memory.py",
        "looking = self.held + 2 * (n + self.k) + m + 5 if self.struct.closing else 0",
        "5 -> 6",
    ): "room for one number more",
    (
        "wbc/constraints/limits.py",
        "checked = finite_vector(what, np.where(np.isposinf(given), 1.0, given), size)",
        "1.0 -> 2.001",
    ): "any finite number: what is infinite is kept",
    (
        "wbc/controllers/contact_forces.py",
        "found = np.zeros(self.size, dtype=bool)",
        "zeros -> ones",
    ): "each place is written",
    (
        "wbc/constraints/validation.py",
        "for k in np.flatnonzero(lower > upper)[:1]:",
        "1 -> 2",
    ): "the first is raised",
    (
        "wbc/constraints/independent_rows.py",
        "levers = [contact.position - origin for contact in contacts]",
        "Sub -> Add",
    ): "the rank does not depend on the point of reference",
    (
        "wbc/tasks/weights.py",
        'one = not isinstance(weight, Iterable) or getattr(weight, "ndim", 1) == 0',
        "1 -> 2",
    ): "any number but 0",
    (
        "wbc/controllers/contact_forces.py",
        "local = part.grasp.reshape(2, 3, -1)",
        "1 -> 2",
    ): "any negative number: NumPy works it out",
    (
        "wbc/controllers/torque.py",
        "P, g = plan.memory.cost(-1)",
        "1 -> 2",
    ): "any negative number: all levels",
}


def share(killed: int, total: int) -> str:
    """Return a share with its 95 % interval (Wilson)."""
    low, high = binomtest(killed, total).proportion_ci(method="wilson")
    return f"{100 * killed / total:.1f} % (95 %: {100 * low:.1f} to {100 * high:.1f})"


def report(sample: list[Fault], found: dict[str, dict[str, Any]]) -> str:
    """Return a summary of the faults tried so far."""
    tried = [fault for fault in sample if fault.key in found]
    verdicts = {one.key: str(found[one.key]["verdict"]) for one in tried}
    same = [one for one in tried if (one.file, one.text, one.what) in EQUIVALENT]
    rest = [one for one in tried if one not in same]
    killed = Counter(one.file.split("/")[1] for one in rest if verdicts[one.key] in NOTICED)
    total = Counter(one.file.split("/")[1] for one in rest)
    lines = [
        f"{one.file}:{one.line}: [{verdicts[one.key]}] {one.what}: {one.text}"
        for one in sorted(rest)
        if verdicts[one.key] not in NOTICED
    ]
    lines += [f"{room}: {killed[room]} of {total[room]} killed" for room in sorted(total)]
    if rest:
        counts = f"{killed.total()} of {len(rest)} faults noticed, "
        lines.append(f"{counts}{share(killed.total(), len(rest))}; {len(same)} equivalent")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--faults", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="part of the files' names")
    parser.add_argument("--fresh", action="store_true", help="forget what was found before")
    options = parser.parse_args()
    os.chdir(ROOT)
    os.environ["OMP_NUM_THREADS"] = "1"  # before anything looks
    for name in ("coal", "numpy", "pinocchio", "scipy.linalg", "scipy.optimize"):
        importlib.import_module(name)  # here, once; nothing of wbc, which has the faults
    RESULTS.mkdir(exist_ok=True)
    path, watched = RESULTS / f"mutation_{options.seed}.json", RESULTS / "mutation_tests.json"
    if options.fresh:
        path.unlink(missing_ok=True)
        watched.unlink(missing_ok=True)
    every = [fault for fault in faults() if options.only in fault.file]
    sample = random.Random(options.seed).sample(every, min(options.faults, len(every)))
    print(f"seed {options.seed}: {len(sample)} of {len(every)} faults", flush=True)
    trials = Trials(sample, path, watched)
    if forked(trials.run, 0):
        raise SystemExit("the tests could not be collected, or a fault not be put in: see above")
    tried_afresh(trials)
    print(report(sample, trials.found()))
    print(f"every verdict, and which test found it: {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
