"""Watch a simulated craft discover its own physics, step by step."""

import ground

model = ground.Model.load("cfg/hovercraft/tiny_whoover.yaml")
craft = model + ground.Effect("motor_lag", tau=0.05)


def watch(story):
    if story.activity:
        print("%3.0f s flown: %s" % (story.flown, story.activity.split(":")[0]))


found = ground.discover(model, craft, "discovery", budget=60, track=False, told=watch)
print(found.effects, found.to_frame().round(2), sep="\n")
