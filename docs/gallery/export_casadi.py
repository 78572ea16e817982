"""A model as CasADi functions, with derivatives for optimisation (pip install casadi)."""

import runpy

import casadi as ca

import ground

craft = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml").with_effect("quadratic_drag", cx=0.01)
craft.export("craft_casadi.py", "casadi", force=True)

derivative, step, measure = runpy.run_path("craft_casadi.py")["functions"]()
x, u = ca.SX.sym("x", 6), ca.SX.sym("u", 3)
slopes = ca.Function("slopes", [x, u], [ca.jacobian(step(x, u, 0.02, 0), u)])
print(slopes(ca.DM.zeros(6), [0.5, 0.5, 1]).full().round(4))  # of x to r, by left, right and lift
