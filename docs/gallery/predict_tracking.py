"""Predict a run of a controller: how far the model is off after half a second, one and two."""

import ground

model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
flown = model + ground.Effect("quadratic_drag", cx=0.02, cy=0.02)
run = ground.simulate(flown, "tracking", reference="rhodonea", duration=20)
for horizon in (0.5, 1.0, 2.0):
    without, true = (one.predict(run, horizon).position_mm for one in (model, flown))
    print("after %.1f s: %3.0f mm, with the drag %3.0f mm" % (horizon, without, true))
