"""What `discover` chose, fitted once more to everything."""

from benchmarks.run_machines import fitted_to_all
from tests.identify.test_machine_discovery import NOISE, UNKNOWN, rig
from tests.identify.test_machine_joint_load import columns, square
from tssgeom.identify.machine_discovery import MachineCampaign, machine_work
from tssgeom.identify.machine_run import machine_run
from tssgeom.tendon.machine import route_of_rig
from tssgeom.uncertain import UNKNOWNS, Uncertain


def test_a_law_stays_in_a_model_that_is_fitted_to_all_rows():
    hardware = rig(2)
    run = machine_run("run", columns(14, torque=True, spring=square), [route_of_rig(hardware)], hardware)
    uncertain = tuple(Uncertain(key, UNKNOWNS[key], stated=False) for key in UNKNOWN)
    work, _ = machine_work(MachineCampaign("bench", hardware, uncertain, (run,)))
    assert work.chosen.model.problem.laws
    every = fitted_to_all(work)
    assert all(len(at) > 400 for _, _, at in every.problem.rows)
    for channel, off in every.fitted.items():
        assert off < 1.5 * NOISE[channel]  # without the law it is far beyond
