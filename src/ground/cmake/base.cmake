# Compiler options and dependencies of the core, with ROS (../CMakeLists.txt) and without
# (../python/CMakeLists.txt).
get_filename_component(ground_source_dir ${CMAKE_CURRENT_LIST_DIR}/.. ABSOLUTE)
set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(ground_warnings -Wall -Wextra -Wshadow CACHE STRING "compiler warnings")
# Nodelets and bindings do little at run time, but their headers take long to optimise.
set(ground_shell_options -O1)

find_package(Eigen3 REQUIRED)
find_package(Threads REQUIRED)
find_package(pybind11 REQUIRED)
find_package(yaml-cpp REQUIRED)
find_library(MUPARSER_LIBRARY muparser REQUIRED)
find_path(MUPARSER_INCLUDE_DIR muParser.h)
# Products of small matrices of fixed size are computed element by element. Beyond 8 rows, Eigen would
# block them for caches, which takes three times as long to compile.
add_compile_definitions(EIGEN_CACHEFRIENDLY_PRODUCT_THRESHOLD=17)
