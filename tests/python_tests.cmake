# Tests in Python: the built program as a user meets it. Included by CMakeLists.txt beside this file.
# Labels: cli (any clone), install, data and reference (skipped, code 77, where the data are not).
find_program(PYTHON3 python3 PATHS /usr/bin NO_DEFAULT_PATH)
if(NOT PYTHON3)
  find_program(PYTHON3 python3 REQUIRED)
endif()

function(kincal_python_test name script label timeout)
  add_test(NAME ${name} COMMAND ${PYTHON3} ${CMAKE_CURRENT_SOURCE_DIR}/${script} ${ARGN})
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT ${timeout} SKIP_RETURN_CODE 77 ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
endfunction()

set(kincal_program ${PROJECT_SOURCE_DIR} $<TARGET_FILE:kincal>)

foreach(group WrongRig WrongRobot WrongSamples WrongArguments Writing Results ExitCodes Simulate SameEverywhere NoNoise)
  kincal_python_test(cli.${group} cli_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Results Failing Resume Sets)
  kincal_python_test(batch.${group} batch_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Planted File)
  kincal_python_test(local.${group} local_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Sets Choice)
  kincal_python_test(instruction_sets.${group} instruction_set_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Pr2Simulated Pr2SimulatedLarge Aubo Panda RosCharuco RosPositioner Hrp2 LinearSolvers UrdfFiles)
  kincal_python_test(data.${group} data_test.py data 900 ${kincal_program} ${group})
endforeach()

kincal_python_test(shuffle.Example shuffle_test.py cli 600 ${kincal_program} Example)
foreach(group Pr2Simulated Aubo AbsentPoses Others)
  kincal_python_test(shuffle.${group} shuffle_test.py data 900 ${kincal_program} ${group})
endforeach()
foreach(group Program Example)
  kincal_python_test(validation.${group} validation_test.py cli 600 ${kincal_program} ${group})
endforeach()
foreach(group Aubo Panda Pr2Simulated)
  kincal_python_test(validation.${group} validation_test.py data 600 ${kincal_program} ${group})
endforeach()
foreach(group Noise Example)
  kincal_python_test(trust_words.${group} trust_words_test.py cli 600 ${kincal_program} ${group})
endforeach()
foreach(group Panda Hrp2)
  kincal_python_test(trust_words.${group} trust_words_test.py data 600 ${kincal_program} ${group})
endforeach()
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  kincal_python_test(data.CpuTime data_test.py data 300 ${kincal_program} CpuTime)
  set_tests_properties(data.CpuTime PROPERTIES RUN_SERIAL ON)
endif()

foreach(set pr2-simulated aubo-i10)
  foreach(mode latent marginal point none)
    kincal_python_test(reference.${set}.${mode} reference_test.py reference 1800 ${kincal_program} ${set} ${mode})
  endforeach()
endforeach()
kincal_python_test(reference.others.latent reference_test.py reference 1800 ${kincal_program} others latent)

kincal_python_test(install install_test.py install 1800 ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR} ${CMAKE_COMMAND})
kincal_python_test(documents docs_test.py cli 900 ${kincal_program})
