# The libraries of the core, without ROS, for the catkin package and for the wheel. Both include
# base.cmake first, and set the folders where libraries are built (ground_lib_output) and installed
# (ground_lib_destination).

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
    $<BUILD_INTERFACE:${ground_source_dir}/include> $<INSTALL_INTERFACE:include>)
  target_include_directories(ground_${folder} SYSTEM PUBLIC ${EIGEN3_INCLUDE_DIRS})
  target_compile_options(ground_${folder} PRIVATE ${ground_warnings})
  set_target_properties(ground_${folder} PROPERTIES EXPORT_NAME ${folder}
    LIBRARY_OUTPUT_DIRECTORY ${ground_lib_output})
  set_property(GLOBAL APPEND PROPERTY ground_libraries ground_${folder})
endfunction()

# The core for processors with wider registers. ON: an additional library for each level, in folders
# where the loader of glibc looks first on such a machine (2.33 and later; others load the plain
# library). NATIVE: one library for the processor that builds it, which does not run on older ones;
# tests compare it with the plain one in lib/plain, which also checks bounds. Eigen would align and
# allocate differently there and is set to a common alignment: the compiler and Lanes use the wide
# registers.
set(GROUND_WIDE ON CACHE STRING
  "build the core for AVX2 and AVX-512 as well, chosen when it is loaded: ON, OFF, or NATIVE for this processor only")
include(CheckCXXCompilerFlag)
set(ground_levels)
if(GROUND_WIDE)
  execute_process(COMMAND /lib64/ld-linux-x86-64.so.2 --help
    OUTPUT_VARIABLE loader ERROR_VARIABLE loader)
  foreach(level 3 4)
    check_cxx_compiler_flag(-march=x86-64-v${level} ground_has_v${level})
    if(ground_has_v${level} AND NOT GROUND_WIDE STREQUAL "NATIVE")
      list(APPEND ground_levels ${level})
    elseif(ground_has_v${level} AND loader MATCHES "x86-64-v${level} \\(supported")
      set(ground_levels ${level})
    endif()
  endforeach()
endif()
# Removes libraries of an earlier build with another choice, which would be loaded instead.
file(GLOB ground_left ${ground_lib_output}/plain/libground_*.so
  ${ground_lib_output}/glibc-hwcaps/*/libground_*.so)
if(ground_left AND NOT GROUND_WIDE STREQUAL "${ground_wide_before}")
  file(REMOVE ${ground_left})
endif()
set(ground_wide_before ${GROUND_WIDE} CACHE INTERNAL "GROUND_WIDE when it was last configured")
# The library of a folder, built again for a kind of processor, in a folder below lib.
function(ground_core_again folder kind where)
  get_target_property(sources ground_${folder} SOURCES)
  get_target_property(libraries ground_${folder} LINK_LIBRARIES)
  get_target_property(unity ground_${folder} UNITY_BUILD)
  set(again ground_${folder}_${kind})
  add_library(${again} SHARED ${sources})
  target_include_directories(${again} PRIVATE ${ground_source_dir}/include)
  target_include_directories(${again} SYSTEM PRIVATE ${EIGEN3_INCLUDE_DIRS} ${MUPARSER_INCLUDE_DIR})
  target_compile_options(${again} PRIVATE ${ground_warnings} ${ground_core_options})
  target_link_libraries(${again} PRIVATE ${libraries})
  set_target_properties(${again} PROPERTIES OUTPUT_NAME ground_${folder} UNITY_BUILD ${unity}
    LIBRARY_OUTPUT_DIRECTORY ${ground_lib_output}/${where})
endfunction()
function(ground_for_level target level)
  # gcc 12 warns of its own AVX-512 headers (bug 105593).
  target_compile_options(${target} PRIVATE -Wno-maybe-uninitialized -march=x86-64-v${level})
  target_compile_definitions(${target} PRIVATE EIGEN_DONT_VECTORIZE EIGEN_MAX_ALIGN_BYTES=16
    EIGEN_MAX_STATIC_ALIGN_BYTES=16)
  # Numbers with derivatives are blocks of some hundred bytes. gcc clears and copies such blocks by
  # instructions that take long to begin, and from which the next load has to wait.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    foreach(block memset memcpy)
      target_compile_options(${target} PRIVATE
        -m${block}-strategy=vector_loop:4096:noalign,libcall:-1:noalign)
    endforeach()
  endif()
endfunction()
# The library of a folder for any processor, in lib/plain, for tests: containers and Eigen's arrays
# end the program at an index or a size that is wrong.
function(ground_plain_library folder)
  ground_core_again(${folder} plain plain)
  set_target_properties(ground_${folder}_plain PROPERTIES EXCLUDE_FROM_ALL ON)
  # Quick to compile, because only tests use it; gcc warns of Eigen's headers at -O1.
  target_compile_options(ground_${folder}_plain PRIVATE -UNDEBUG -D_GLIBCXX_ASSERTIONS
    ${ground_shell_options} -Wno-maybe-uninitialized)
  set_property(GLOBAL APPEND PROPERTY ground_plain_libraries ground_${folder}_plain)
endfunction()
function(ground_wide_library folder)
  if(GROUND_WIDE STREQUAL "NATIVE" AND ground_levels)
    ground_plain_library(${folder})
    ground_for_level(ground_${folder} ${ground_levels})
    return()
  endif()
  foreach(level ${ground_levels})
    set(where glibc-hwcaps/x86-64-v${level})
    ground_core_again(${folder} v${level} ${where})
    ground_for_level(ground_${folder}_v${level} ${level})
    add_dependencies(ground_${folder} ground_${folder}_v${level})
    install(TARGETS ground_${folder}_v${level}
      LIBRARY DESTINATION ${ground_lib_destination}/${where})
  endforeach()
endfunction()
# No code reads errno after a square root. These libraries and their users pass Lanes by value
# differently; this is harmless because only inline functions do so, and each library uses its own
# copy.
set(ground_core_options -fno-math-errno -Wno-psabi -fvisibility-inlines-hidden)

ground_library(model)
# The effects are many small files: their headers take most of the time to compile.
file(GLOB sources CONFIGURE_DEPENDS ${ground_source_dir}/src/model/*.cpp)
set_source_files_properties(${sources} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
set_target_properties(ground_model PROPERTIES UNITY_BUILD ON)
target_include_directories(ground_model SYSTEM PRIVATE ${MUPARSER_INCLUDE_DIR})
target_compile_options(ground_model PUBLIC ${ground_core_options})
target_link_libraries(ground_model PRIVATE yaml-cpp ${MUPARSER_LIBRARY} ${CMAKE_DL_LIBS})
ground_wide_library(model)

ground_library(estimation)
target_link_libraries(ground_estimation PUBLIC ground_model)

ground_library(control)
target_link_libraries(ground_control PUBLIC ground_model ground_estimation PRIVATE yaml-cpp)
ground_wide_library(control)

ground_library(simulation)
target_link_libraries(ground_simulation PUBLIC ground_model ground_control ground_estimation)

ground_library(identification)
target_link_libraries(ground_identification PUBLIC ground_model Threads::Threads
  PRIVATE ${CERES_LIBRARIES})
ground_wide_library(identification)

if(TARGET ground_model_plain)
  foreach(folder estimation simulation)
    ground_plain_library(${folder})
  endforeach()
endif()
