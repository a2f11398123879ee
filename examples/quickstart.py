"""Train, export, race, report: the whole way from Python.

python examples/quickstart.py
"""

import sprintlab as sl

if __name__ == "__main__":  # a race starts processes, and each reads this file
    settings = sl.method("acs", environments=4096)  # robot="robots/mydog" for a robot of yours
    run = sl.train(settings, output="runs/quickstart", iterations=1600, minutes=20.0)
    policy = run.policy
    race = sl.race(policy, trials=10)
    print(race)
    print(race.report("runs/quickstart-race"))
