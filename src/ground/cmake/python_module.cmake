# The Python module ground._core, for the catkin package and for the wheel. Both include base.cmake
# first, and set ground_VERSION and the folders where the module is built (ground_module_output) and
# installed (ground_module_destination).

file(GLOB bindings CONFIGURE_DEPENDS ${ground_source_dir}/src/python/*.cpp)
pybind11_add_module(ground_core MODULE NO_EXTRAS ${bindings})
set_target_properties(ground_core PROPERTIES
  OUTPUT_NAME _core
  LIBRARY_OUTPUT_DIRECTORY ${ground_module_output})
# At -O1 gcc 12 warns that members of pybind11's casters are uninitialised.
# Derivatives (jet.h) are those of the core, for the same processor.
target_compile_options(ground_core PRIVATE ${ground_warnings} ${ground_shell_options} ${ground_native}
  -Wno-maybe-uninitialized)
target_compile_definitions(ground_core PRIVATE GROUND_VERSION="${ground_VERSION}")
target_link_libraries(ground_core PRIVATE
  ground::model ground::estimation ground::safety ground::control ground::simulation ground::identification)
install(TARGETS ground_core LIBRARY DESTINATION ${ground_module_destination})
