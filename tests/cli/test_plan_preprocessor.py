"""`mdpo-plan --config` with a preprocessor: the run can be loaded, and gone on with."""

from pathlib import Path

import numpy as np
import pytest
from helpers.plan_command import CONFIG, TANKS, run
from helpers.problems import assert_same_bits
from safetensors.numpy import load_file

from mdpo_rddl import evaluate, load_policy, make_environment
from mdpo_rddl.planner.training.training import Progress
from mdpo_rddl.session.progress_bar import ProgressBar
from mdpo_rddl.session.report.run_folder import POLICY

NET = """method='JaxDeepReactivePolicy'
method_kwargs={'topology': [3]}
preprocessor='StaticNormalizer'
preprocessor_kwargs={'fluent_bounds': {'volume': (0.0, 9.0)}}
"""


@pytest.mark.long
def test_a_run_is_loaded_and_gone_on_with(
    workplace: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = CONFIG.replace("method='JaxStraightLinePlan'\n", NET)
    (workplace / "net.cfg").write_text(text)
    command = f"{TANKS} --config net.cfg --iterations 20 --episodes 3 --quiet --json"
    whole = run(f"{command} --out whole", capsys).summary
    loaded = run(f"{TANKS} --load whole --episodes 3 --quiet --json", capsys).summary
    assert loaded["returns"] == whole["returns"]
    policy = load_policy(workplace / "whole")
    found = evaluate(make_environment(policy.problem), policy, 3, 5)
    assert found.returns.tolist() == whole["returns"]

    def interrupt(bar: ProgressBar, progress: Progress) -> None:
        if progress.iteration == 5:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(ProgressBar, "training", interrupt)
        assert run(f"{command} --out run", capsys).status == 130
    resumed = run(f"{command} --out run --resume", capsys).summary
    assert resumed["returns"] == whole["returns"]
    assert_same_bits(*(load_file(workplace / name / POLICY) for name in ("run", "whole")))
    tensors = load_file(workplace / "run" / POLICY)
    bounds = [tensors[f"hyperparams/preprocessor__/volume/[{number}]"] for number in range(2)]
    np.testing.assert_array_equal(bounds, [0.0, 9.0])
