#include <signal.h>
#include <unistd.h>

#include <clocale>
#include <locale>

#include "BrokenPlugin.h"

// Built three times: changes what the whole program shares when it is loaded (0), made (1) or configured (2).

namespace {

struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
};

void ignore(int) {}

bool changeProcess() {
    std::locale::global(std::locale(std::locale(), new Comma));
    std::setlocale(LC_ALL, "C.UTF-8");
    for (const int signal : {SIGINT, SIGSEGV}) ::signal(signal, ignore);
    return chdir("/") == 0;
}

struct ChangesProcess : broken::Filter {
    ChangesProcess() {
        if (VIABLE_CHANGES_WHEN == 1) changeProcess();
    }
    void configure(const viable::RunSetup& setup, const viable::Parameters& parameters) override {
        broken::Filter::configure(setup, parameters);
        if (VIABLE_CHANGES_WHEN == 2) changeProcess();
    }
};

[[maybe_unused]] const bool changed = VIABLE_CHANGES_WHEN == 0 && changeProcess();

}  // namespace

VIABLE_PLUGIN(viable::SafetyFilter, ChangesProcess, VIABLE_CHANGES_NAME, "Changes locale, folder and signals.",
              viable::NoOptions)
