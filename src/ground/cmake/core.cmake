# The libraries of the core, without ROS, for the catkin package and for the wheel. Both include
# base.cmake first, find Python3, and set the folders where libraries are built (ground_lib_output) and installed
# (ground_lib_destination).

# Wide registers make derivatives three times as quick. Eigen would align otherwise: the compiler uses them.
set(GROUND_NATIVE OFF CACHE STRING "processor of the core: ON: this one; OFF: any; else one of gcc's -march")
if(GROUND_NATIVE)
  string(REGEX REPLACE "^(ON|TRUE|1)$" native processor ${GROUND_NATIVE})
  set(ground_native -march=${processor} -DEIGEN_DONT_VECTORIZE -DEIGEN_MAX_ALIGN_BYTES=16
    -DEIGEN_MAX_STATIC_ALIGN_BYTES=16 -Wno-maybe-uninitialized)
endif()

# The structs of parameters, from the .cfg files
set(ground_cfg ${ground_source_dir}/../../cfg)
set(ground_parameters ${ground_source_dir}/cmake/parameter_structs.py)
set(ground_headers ${CMAKE_BINARY_DIR}/include)
if(CATKIN_DEVEL_PREFIX)
  set(ground_headers ${CATKIN_DEVEL_PREFIX}/include)
endif()
file(GLOB configs CONFIGURE_DEPENDS ${ground_cfg}/*.cfg ${ground_cfg}/*.py)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${configs} ${ground_parameters})
execute_process(COMMAND ${Python3_EXECUTABLE} ${ground_parameters} ${ground_cfg} ${ground_headers}/ground/parameters
  RESULT_VARIABLE failed)
if(failed)
  message(FATAL_ERROR "the structs of parameters cannot be written")
endif()

# One library for each folder. A new file in a folder (such as a physical effect) needs no edit here.
function(ground_library folder)
  file(GLOB sources CONFIGURE_DEPENDS ${ground_source_dir}/src/${folder}/*.cpp
    ${ground_source_dir}/src/${folder}/*/*.cpp)
  if(NOT sources)
    return()
  endif()
  add_library(ground_${folder} SHARED ${sources} ${ARGN})
  add_library(ground::${folder} ALIAS ground_${folder})
  target_compile_features(ground_${folder} PUBLIC cxx_std_17)
  target_include_directories(ground_${folder} PUBLIC
    $<BUILD_INTERFACE:${ground_source_dir}/include> $<BUILD_INTERFACE:${ground_headers}> $<INSTALL_INTERFACE:include>)
  target_include_directories(ground_${folder} SYSTEM PUBLIC ${EIGEN3_INCLUDE_DIRS})
  target_compile_options(ground_${folder} PRIVATE ${ground_warnings} ${ground_native})
  set_target_properties(ground_${folder} PROPERTIES EXPORT_NAME ${folder}
    LIBRARY_OUTPUT_DIRECTORY ${ground_lib_output})
  set_property(GLOBAL APPEND PROPERTY ground_libraries ground_${folder})
endfunction()

set(ground_core_options -fno-math-errno)  # no code reads errno after a square root

ground_library(model)
# The headers of effects take most of the time to compile.
file(GLOB sources CONFIGURE_DEPENDS ${ground_source_dir}/src/model/*.cpp)
set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
if(NOT DEFINED CMAKE_UNITY_BUILD OR CMAKE_UNITY_BUILD) # mutants and sanitizers build each file by itself
  set_target_properties(ground_model PROPERTIES UNITY_BUILD ON)
endif()
# A pair of numbers that were just stored one by one would have to wait until it can be loaded at once.
set_property(SOURCE ${ground_source_dir}/src/model/dynamics.cpp APPEND PROPERTY
  COMPILE_OPTIONS -fno-tree-vectorize)
target_include_directories(ground_model SYSTEM PRIVATE ${MUPARSER_INCLUDE_DIR})
target_compile_options(ground_model PUBLIC ${ground_core_options})
# Arithmetic of numbers with derivatives has to be inlined, even into large functions: it is six times
# as fast then.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  target_compile_options(ground_model PRIVATE "SHELL:--param large-function-growth=3000"
    "SHELL:--param inline-unit-growth=500" "SHELL:--param large-stack-frame-growth=5000"
    "SHELL:--param max-inline-insns-auto=200")
endif()
target_link_libraries(ground_model PRIVATE yaml-cpp ${MUPARSER_LIBRARY} ${CMAKE_DL_LIBS})

ground_library(estimation)
target_link_libraries(ground_estimation PUBLIC ground_model)

ground_library(safety)
target_link_libraries(ground_safety PUBLIC ground_model PRIVATE yaml-cpp)

ground_library(control)
target_link_libraries(ground_control PUBLIC ground_model ground_estimation ground_safety PRIVATE yaml-cpp)

ground_library(simulation)
target_link_libraries(ground_simulation PUBLIC ground_model ground_control ground_estimation)

ground_library(identification)
target_link_libraries(ground_identification PUBLIC ground_model Threads::Threads)
