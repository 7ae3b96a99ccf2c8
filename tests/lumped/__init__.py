"""An independent lumped simulator of a tendon in a sheath: referee of the model, source of test runs.

It shares no code and no idea with `tssgeom`: its C (`march.c`) is its own, and is compiled by itself. The
sheath is a polygon; the tendon is bars between its vertices, which pull only; a vertex carries the contact
force that its two bars press into it, and Coulomb friction up to a coefficient times that. No exponential of
an angle stands anywhere: the loss along a curve comes out of the balance of forces. Each step in time is
solved by handing the response curve "motion against tension" of all that lies distal from bar to bar, which
is exact for straight laws (`sweep.c`), so nothing creeps in a hold.

    path = from_pieces([0.1, 0.3, 0.1], [0.0, np.pi, 0.0], cells=64)
    drive = Drive("force", np.array([0.0, 5.0, 10.0]), np.array([2.0, 15.0, 2.0]))
    times = np.linspace(0.0, 10.0, 200)
    run = simulate(path, Physics(pretension_N=2.0), drive, Distal("spring", 3000.0), times)
    columns = measure(run, {"tension_out_N": Sensor(noise=0.05, resolution=0.01)}, seed=1)

`from_pieces`, `from_angle` and `from_points` make paths, static or moving. `Physics` switches every extra
effect by a parameter; with none of them the tendon is linear and the friction Coulomb's. Strains are small,
and a tendon that moves along the sheath keeps the bend, the share of length and the profile of the vertex
that it started at.

Properties that change during a run are given as knots, on the whole sheath or on a stretch of it:

    wet = Change("friction", np.array([5.0, 6.0]), np.array([1.0, 0.4]), start_m=0.2, stop_m=0.4)
    run = simulate(path, physics, drive, distal, times, changes=[wet], ends_only=True)

`simulate_machine` puts several such tendons between one drive (a motor's pulley, or a drive each) and one
mechanism (a joint, or a segment that bends), and `measure_machine` reads it:

    motor = Motor("angle", np.array([0.0, 5.0, 10.0]), np.array([0.0, 0.4, 0.0]), radius_m=0.01)
    pair = [(path, Physics(pretension_N=5.0)), (path, Physics(pretension_N=5.0, friction=0.2))]
    run = simulate_machine(pair, motor, Joint(radius_m=0.01, stiffness_Nm_per_rad=0.2), times)
    columns = measure_machine(run, {"joint_angle_rad": Sensor(noise=1e-3)}, seed=1)

Errors fall with the square of the cell and, on moving paths, with the step in time: 64 cells on the half
circle of the paper are right to 2 mN and 0.1 µm, 160 on routes of up to 8 rad to 4 mN and 0.6 µm. Just after
a position drive turns back, before the front has passed the first vertex, T_in is wrong by up to a quarter
of what that vertex holds (0.01 N at 160 cells and 15 N). Keep the turn of a vertex below 0.1 rad. A step
costs 0.02 ms with 64 cells and 0.06 ms with 160; with curved laws some five times that.

A machine that one motor drives does not depend on the step. With drives or loads that go ways of their own
its error falls with the step: strokes of 25 N in 1 s are right to 0.02 N and 1 mrad in steps of 0.02 s, and
wrong by 0.9 N and 44 mrad in a single one. A run of 20 s in steps of 0.02 s takes 1 s with two tendons of 60
cells, 2 s with three, and 2 to 15 s if the motor's torque is given.
"""

from tests.lumped.changes import Change
from tests.lumped.machine import MachineRun, simulate_machine
from tests.lumped.mechanism import Joint, Motor, Segment
from tests.lumped.physics import Distal, Drive, Physics
from tests.lumped.route import Path, from_angle, from_pieces, from_points
from tests.lumped.sensors import CHANNELS, Sensor, machine_channels, measure, measure_machine, true_channels
from tests.lumped.simulate import NoBalanceError, Run, simulate

__all__ = [
    "CHANNELS",
    "Change",
    "Distal",
    "Drive",
    "Joint",
    "MachineRun",
    "Motor",
    "NoBalanceError",
    "Path",
    "Physics",
    "Run",
    "Segment",
    "Sensor",
    "from_angle",
    "from_pieces",
    "from_points",
    "machine_channels",
    "measure",
    "measure_machine",
    "simulate",
    "simulate_machine",
    "true_channels",
]
