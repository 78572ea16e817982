# setup.bash puts the folder of the library into LD_LIBRARY_PATH: its name is enough.
export GROUND_EFFECT_LIBRARIES="libground_example_effects.so:$GROUND_EFFECT_LIBRARIES"
