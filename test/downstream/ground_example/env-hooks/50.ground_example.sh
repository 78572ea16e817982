# A name without a folder suffices: setup.bash puts the library's folder into LD_LIBRARY_PATH.
export GROUND_EFFECT_LIBRARIES="libground_example_effects.so:$GROUND_EFFECT_LIBRARIES"
