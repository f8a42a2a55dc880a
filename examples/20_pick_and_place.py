"""Pick and place with contact physics: a KR210 takes a can out of a shelf and drops it into a bin, stage by stage."""

from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.tasks import pick_tasks

try:
    from pieper.tasks.pick import PickAndPlace

    task = pick_tasks.task("kr210")  # or ur10e, mh12, youbot
    run = PickAndPlace(task, seed=1, log=print)  # cans stand up to 5 mm and 5 deg from their places
except (MissingExtraError, MissingLibraryError) as reason:
    print(f"not simulated: {reason}")
else:
    print(f"{task.arm.name}: {len(task.targets)} cans, fingers press with {task.gripper.force:g} N")
    print(f"can 2 stands at {run.robot.pose('can 2')[:3, 3].round(3)} m")
    cycles = list(run.run(1, first=2))
    print(f"can 2 lies at {run.robot.pose('can 2')[:3, 3].round(2)} m, in the bin")
    print(f"{sum(cycle.placed for cycle in cycles)} of {len(cycles)} placed in {cycles[0].duration:.2f} s")
    print(f"the arm touches: {', '.join(map(str, run.robot.collisions())) or 'nothing'}")
