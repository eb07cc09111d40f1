# Tests in Python (program/): the built program as a user meets it. Included by CMakeLists.txt beside this file.
# Labels: cli (any clone), install, data and reference (skipped, code 77, where the data are not).
find_program(PYTHON3 python3 PATHS /usr/bin NO_DEFAULT_PATH)
if(NOT PYTHON3)
  find_program(PYTHON3 python3 REQUIRED)
endif()

function(kincal_python_test name script label timeout)
  add_test(NAME ${name} COMMAND ${PYTHON3} ${CMAKE_CURRENT_SOURCE_DIR}/program/${script} ${ARGN})
  set_tests_properties(${name} PROPERTIES LABELS ${label} TIMEOUT ${timeout} SKIP_RETURN_CODE 77 ENVIRONMENT "PYTHONDONTWRITEBYTECODE=1")
endfunction()

set(kincal_program ${PROJECT_SOURCE_DIR} $<TARGET_FILE:kincal>)

foreach(group WrongRig WrongRobot WrongSamples WrongKinds WrongArguments Writing Results ExitCodes Simulate SameEverywhere NoNoise)
  kincal_python_test(cli.${group} cli_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Names Pipes Tampered Sizes Gauges Endless)
  kincal_python_test(faults.${group} faults_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Killed Output Signals Streams Names Progress Hardened)
  kincal_python_test(writing.${group} writing_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Results Failing Resume Sets)
  kincal_python_test(batch.${group} batch_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group Planted File)
  kincal_python_test(local.${group} local_test.py cli 600 ${kincal_program} ${group})
endforeach()

<<<<<<< HEAD
foreach(group Export Import Poses HandEye)
  kincal_python_test(exchange.${group} exchange_test.py cli 300 ${kincal_program} ${group})
=======
foreach(group Result WrongInput)
  kincal_python_test(intrinsics.${group} intrinsics_test.py cli 300 ${kincal_program} ${group})
>>>>>>> wt-intrinsics
endforeach()

foreach(group Detect Missing)
  kincal_python_test(detect.${group} detect_test.py cli 300 ${kincal_program} ${group})
endforeach()

kincal_python_test(outliers.Simulated outliers_test.py cli 600 ${kincal_program} Simulated)
kincal_python_test(outliers.Data outliers_test.py data 600 ${kincal_program} Data)

foreach(group Sets Choice)
  kincal_python_test(instruction_sets.${group} instruction_set_test.py cli 600 ${kincal_program} ${group})
endforeach()

foreach(group PlantedEye PlantedFixed PlantedTracker PlantedStereo PlantedPr2 Nothing Answer)
  kincal_python_test(check.${group} check_test.py cli 600 ${kincal_program} ${group})
endforeach()
foreach(group RealSilent RealBadGroup RealPlanted)
  kincal_python_test(check.${group} check_test.py data 600 ${kincal_program} ${group})
endforeach()
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  kincal_python_test(check.RealTime check_test.py data 300 ${kincal_program} RealTime)
  set_tests_properties(check.RealTime PROPERTIES RUN_SERIAL ON)
endif()

foreach(group Pr2Simulated Pr2SimulatedLarge Aubo Panda RosCharuco RosPositioner Hrp2 LinearSolvers UrdfFiles)
  kincal_python_test(data.${group} data_test.py data 900 ${kincal_program} ${group})
endforeach()

kincal_python_test(shuffle.Example shuffle_test.py cli 600 ${kincal_program} Example)
foreach(group Pr2Simulated Aubo AbsentPoses Others)
  kincal_python_test(shuffle.${group} shuffle_test.py data 900 ${kincal_program} ${group})
endforeach()
foreach(group Init Parallel Aubo Panda Others)
  kincal_python_test(automatic.${group} automatic_test.py data 300 ${kincal_program} ${group})
endforeach()
kincal_python_test(newcomer newcomer_test.py cli 300 ${kincal_program})

foreach(group Warnings Endings Unseen Quiet)
  kincal_python_test(input.${group} input_test.py cli 300 ${kincal_program} ${group})
endforeach()
foreach(group Mount Init Mounts Words)
  kincal_python_test(first_steps.${group} first_steps_test.py cli 300 ${kincal_program} ${group})
endforeach()
foreach(group Program Example)
  kincal_python_test(validation.${group} validation_test.py cli 600 ${kincal_program} ${group})
endforeach()
foreach(group Aubo Panda Pr2Simulated)
  kincal_python_test(validation.${group} validation_test.py data 600 ${kincal_program} ${group})
endforeach()
foreach(group ExitCode Words)
  kincal_python_test(verdict.${group} verdict_test.py cli 600 ${kincal_program} ${group})
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
foreach(group Solver Components Embedding)
  kincal_python_test(package.${group} package_test.py install 900 ${PROJECT_SOURCE_DIR} ${PROJECT_BINARY_DIR} ${CMAKE_COMMAND} ${group})
endforeach()
kincal_python_test(documents docs_test.py cli 900 ${kincal_program})
kincal_python_test(structure.Folders ../structure_test.py cli 60 ${PROJECT_SOURCE_DIR})  # who includes whom
