"""Compare two fitted models on a run that neither has seen, as a table."""

import ground

model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
flown = model + ground.Effect("motor_lag", tau=0.05)
runs = [ground.simulate(flown, duration=10, seed=seed) for seed in (1, 2)]
test = ground.simulate(flown, "multilevel-prbs", duration=10, seed=3, name="test")
plain = ground.fit(model, runs).model
lagging = ground.add(model, "motor_lag", runs).model
found = ground.compare({"plain": plain, "lagging": lagging}, test)
print(found.to_frame()[["error", "fit_u", "fit_v", "fit_r"]].round(3))
found.save("comparison")
