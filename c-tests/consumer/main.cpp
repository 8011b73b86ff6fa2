// The same header in C++17.
#include <lapd.h>

#include <iostream>
#include <memory>

int main() {
    lapd_params *params = nullptr;
    if (lapd_params_create(&params) != LAPD_OK) {
        return 1;
    }
    std::unique_ptr<lapd_params, decltype(&lapd_params_free)> owner(params, lapd_params_free);
    double delta = 0;
    lapd_status status = lapd_params_get_delta(params, &delta);
    std::cout << "lapd " << lapd_version() << ": " << lapd_status_name(status) << ", delta " << delta << '\n';
    return status == LAPD_OK && delta > 0 ? 0 : 1;
}
