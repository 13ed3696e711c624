"""lcdata validate."""

from __future__ import annotations

import typer

from lcdata.cli.common import EXIT_SOME_FAILED, DatasetPath, JsonFlag, counted, guarded, print_json

EXAMPLE = "lcdata validate dataset"


@guarded
def validate(dataset: DatasetPath, as_json: JsonFlag = False) -> None:
    """Check a data set: schema, checksums, geometry."""
    from lcdata.dataset.schema import INFO
    from lcdata.dataset.validate import validate as find_problems
    from lcdata.errors import DatasetError

    if not (dataset / INFO).is_file():
        raise DatasetError(
            f"{dataset} is no data set (no {INFO})",
            "`lcdata build RECORDINGS -o DATASET` makes one",
        )
    problems = find_problems(dataset)
    if as_json:
        print_json({"dataset": dataset, "valid": not problems, "problems": problems})
    else:
        for problem in problems:
            print(problem)
        print(
            f"{dataset}: {counted(len(problems), 'problem')}" if problems else f"{dataset}: valid"
        )
    if problems:
        raise typer.Exit(EXIT_SOME_FAILED)
