"""A fit for MATLAB or Octave: parameters, what was measured, and what the models predict."""

from scipy.io import loadmat

import ground

craft = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
runs = [ground.simulate(craft, "prbs", duration=10, seed=s, name="run %d" % s) for s in (1, 2)]
ground.fit(craft.with_values({"k": 0.05}), runs).to_mat("fit.mat", force=True)

found = loadmat("fit.mat", squeeze_me=True, struct_as_record=False)  # in MATLAB: load fit.mat
for p in filter(lambda p: p.identified, found["parameters"]):
    print("%-4s %10.4g %-6s %s" % (p.name, p.value, p.unit, p.ci95))
errors = {one.seconds: one.position_mm for one in found["runs"][0].predicted[1].after}
print("off after a second: %.1f mm" % errors[1.0])
