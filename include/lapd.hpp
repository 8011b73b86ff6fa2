// lapd for C++17 and later: move-only owners, views and exceptions over lapd.h, and nothing else.
// SPDX-License-Identifier: MIT OR Apache-2.0
//
//     lapd::context context;
//     lapd::params params;
//     params.set_delta(1).set_size(2);
//     lapd::image image = lapd::image::read(context, "atlas.nii.gz");
//     lapd::mesh mesh = lapd::mesh::make(context, image, params);
//     mesh.write(context, "atlas.vtu");
//
// Conventions
// - What lapd.h says holds here too: units, shapes, thread safety, who may change what. Every
//   member calls the function of the same name, where its text stands.
// - A status other than LAPD_OK becomes a lapd::error, which carries the status and the message. A
//   partial mesh that was asked for is returned instead. Members may throw std::bad_alloc.
// - context, image, params and mesh own their handle and free it. They can be moved, not copied.
//   One that was moved from holds NULL, which every function refuses: its members throw. get()
//   gives the handle for calls that are not here.
// - Arrays come as views, without copying. A view is valid as long as the object that it came
//   from, wherever that is moved to; for params: until they are changed.
// - Callbacks may throw. The exception does not cross the C interface: the run is cancelled, and
//   the exception leaves the call of this header that was running. What that call made is freed.
#ifndef LAPD_HPP
#define LAPD_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>
#if __cplusplus >= 202002L
#include <ranges>
#endif

#include "lapd.h"

namespace lapd {

/// A call failed. what() is the one line that the context keeps, or, of a call without a context,
/// what the status means.
class error : public std::runtime_error {
  public:
    error(lapd_status status, const std::string &message)
        : std::runtime_error(message), status_(status) {
    }
    lapd_status status() const noexcept {
        return status_;
    }

  private:
    lapd_status status_;
};

/// A view of `size()` values that belong to somebody else. It is the same type in C++17 and in
/// C++20, so that objects compiled by either can be linked together; in C++20 it converts to
/// std::span<const T>.
template <class T> class span {
  public:
    using value_type = T;
    constexpr span() noexcept = default;
    constexpr span(const T *data, std::size_t size) noexcept : data_(data), size_(size) {
    }
    constexpr const T *data() const noexcept {
        return data_;
    }
    constexpr std::size_t size() const noexcept {
        return size_;
    }
    constexpr bool empty() const noexcept {
        return size_ == 0;
    }
    constexpr const T *begin() const noexcept {
        return data_;
    }
    constexpr const T *end() const noexcept {
        return data_ + size_;
    }
    constexpr const T &operator[](std::size_t i) const noexcept {
        return data_[i];
    }

  private:
    const T *data_ = nullptr;
    std::size_t size_ = 0;
};

/// A view of `size()` rows of N values each, one after the other: rows[i][k], k below N.
template <class T, std::size_t N> class rows {
  public:
    static constexpr std::size_t width = N;
    constexpr rows() noexcept = default;
    constexpr rows(const T *data, std::size_t size) noexcept : data_(data), size_(size) {
    }
    constexpr const T *data() const noexcept {
        return data_;
    }
    constexpr std::size_t size() const noexcept {
        return size_;
    }
    constexpr bool empty() const noexcept {
        return size_ == 0;
    }
    constexpr const T *operator[](std::size_t i) const noexcept {
        return data_ + N * i;
    }
    /// All values, size() * N of them.
    constexpr span<T> values() const noexcept {
        return {data_, size_ * N};
    }

  private:
    const T *data_ = nullptr;
    std::size_t size_ = 0;
};

namespace detail {

template <class T, void (*Free)(T *)> struct deleter {
    void operator()(T *handle) const noexcept {
        Free(handle);
    }
};

/// Of calls without a context.
inline void check(lapd_status status) {
    if (status != LAPD_OK) {
        throw error(status,
                    std::string(lapd_status_name(status)) + ": " + lapd_status_message(status));
    }
}

inline void check(lapd_status status, const lapd_context *context) {
    if (status != LAPD_OK) {
        throw error(status, lapd_context_last_error(context));
    }
}

template <class T> constexpr std::int32_t voxel_type() noexcept {
    static_assert(std::is_integral_v<T> && !std::is_same_v<T, bool>, "voxels are integers");
    constexpr bool is_signed = std::is_signed_v<T>;
    switch (sizeof(T)) {
    case 1:
        return is_signed ? LAPD_VOXEL_I8 : LAPD_VOXEL_U8;
    case 2:
        return is_signed ? LAPD_VOXEL_I16 : LAPD_VOXEL_U16;
    case 4:
        return is_signed ? LAPD_VOXEL_I32 : LAPD_VOXEL_U32;
    default:
        return is_signed ? LAPD_VOXEL_I64 : LAPD_VOXEL_U64;
    }
}

} // namespace detail

/// The version of the library that runs.
inline const char *version() noexcept {
    return lapd_version();
}

/// The optional parts that the library was built with, separated by spaces.
inline const char *features() noexcept {
    return lapd_features();
}

/// What a progress callback wants.
enum class answer { go_on, cancel };

using progress_callback = std::function<answer(const lapd_progress &progress)>;
using log_callback = std::function<void(lapd_log_level level, const char *message)>;

/// lapd_context: messages, callbacks, cancellation. One thread at a time, but for cancel().
class context {
  public:
    context() : callbacks_(std::make_unique<callbacks>()) {
        lapd_context *handle = nullptr;
        detail::check(lapd_context_create(&handle));
        handle_.reset(handle);
        // Always set: an exception of the log callback cancels through the progress callback.
        detail::check(lapd_context_set_progress(handle, call_progress, callbacks_.get()), handle);
        detail::check(lapd_context_set_log(handle, call_log, callbacks_.get()), handle);
    }

    /// Both replace what was set before; nullptr means none. Not to be called from a callback of
    /// the same context.
    void set_progress(progress_callback callback) {
        require_handle();
        callbacks_->progress = std::move(callback);
    }
    void set_log(log_callback callback) {
        require_handle();
        callbacks_->log = std::move(callback);
    }

    /// Which volume of files that hold several; -1: a file has one.
    void set_volume(std::int64_t volume) {
        check(lapd_context_set_volume(handle_.get(), volume));
    }
    /// What files that are read with this context may ask for: bytes of memory (0 for the
    /// default), and data files outside of their header's folder.
    void set_max_read_bytes(std::uint64_t bytes) {
        check(lapd_context_set_max_read_bytes(handle_.get(), bytes));
    }
    void set_allow_outside(bool allow) {
        check(lapd_context_set_allow_outside(handle_.get(), allow));
    }

    /// From any thread and from a signal handler, as long as the context is neither moved nor
    /// destroyed meanwhile.
    void cancel() const noexcept {
        lapd_context_cancel(handle_.get());
    }
    void reset_cancel() {
        check(lapd_context_reset_cancel(handle_.get()));
    }
    const char *last_error() const noexcept {
        return lapd_context_last_error(handle_.get());
    }
    lapd_context *get() const noexcept {
        return handle_.get();
    }

    /// After a call with get(): throws what a callback threw during the call, or the error of a
    /// status that is not LAPD_OK.
    void check(lapd_status status) const {
        if (callbacks_ != nullptr && callbacks_->thrown != nullptr) {
            std::rethrow_exception(std::exchange(callbacks_->thrown, nullptr));
        }
        detail::check(status, handle_.get());
    }

  private:
    /// Where the C interface finds the callbacks; stays in place when the context is moved. No
    /// lock: callbacks run on the thread that made the call.
    struct callbacks {
        progress_callback progress;
        log_callback log;
        std::exception_ptr thrown;
    };

    static std::int32_t call_progress(void *user, const lapd_progress *progress) noexcept {
        auto &self = *static_cast<callbacks *>(user);
        try {
            if (self.thrown == nullptr && self.progress &&
                self.progress(*progress) == answer::cancel) {
                return 1;
            }
        } catch (...) {
            self.thrown = std::current_exception();
        }
        return self.thrown != nullptr;
    }

    static void call_log(void *user, std::int32_t level, const char *message) noexcept {
        auto &self = *static_cast<callbacks *>(user);
        try {
            if (self.thrown == nullptr && self.log) {
                self.log(static_cast<lapd_log_level>(level), message);
            }
        } catch (...) {
            self.thrown = std::current_exception();
        }
    }

    void require_handle() const {
        if (handle_ == nullptr) {
            throw error(LAPD_ERROR_INVALID_ARGUMENT, lapd_context_last_error(nullptr));
        }
    }

    /// The handle is freed first.
    std::unique_ptr<callbacks> callbacks_;
    std::unique_ptr<lapd_context, detail::deleter<lapd_context, lapd_context_free>> handle_;
};

/// Where the voxels of a buffer are in memory and in the world; see lapd_image_create.
struct grid {
    std::array<std::size_t, 3> dims{};
    std::array<double, 3> origin{0, 0, 0};
    std::array<double, 3> spacing{1, 1, 1};
    std::array<double, 9> direction{1, 0, 0, 0, 1, 0, 0, 0, 1};
    std::optional<std::array<std::ptrdiff_t, 3>> strides{};
};

/// lapd_image: never changes, any number of threads.
class image {
  public:
    /// Copies voxels of any integer type; `voxels` points to voxel (0, 0, 0).
    template <class T> static image create(context &context, const T *voxels, const grid &grid) {
        lapd_image *handle = nullptr;
        lapd_status status =
            lapd_image_create(context.get(), voxels, detail::voxel_type<T>(), grid.dims.data(),
                              grid.strides ? grid.strides->data() : nullptr, grid.origin.data(),
                              grid.spacing.data(), grid.direction.data(), &handle);
        return adopt(context, status, handle);
    }

    /// Files may be read in another frame than their own; see lapd_world_frame.
    static image read(context &context, const std::string &path,
                      lapd_world_frame world = LAPD_WORLD_AS_STORED) {
        lapd_image *handle = nullptr;
        lapd_status status = lapd_image_read(context.get(), path.c_str(), world, &handle);
        return adopt(context, status, handle);
    }
    /// The same, with a choice of what becomes of voxels that are no whole numbers, and of the
    /// order in which the layers of a segmentation count, later over earlier ones; empty for that
    /// of the file.
    static image read_labels(context &context, const std::string &path, lapd_world_frame world,
                             lapd_label_values values,
                             const std::vector<std::size_t> &layer_order = {}) {
        lapd_image *handle = nullptr;
        lapd_status status = lapd_image_read_labels(
            context.get(), path.c_str(), world, values,
            layer_order.empty() ? nullptr : layer_order.data(), layer_order.size(), &handle);
        return adopt(context, status, handle);
    }

    /// Scans, cut into labels at isovalues; without labels these are 1, 2, ...
    static image create_gray(context &context, const float *voxels, const grid &grid,
                             const std::vector<double> &isovalues,
                             const std::vector<std::int32_t> &labels = {}) {
        check_count(labels, isovalues.size(), "isovalues");
        lapd_image *handle = nullptr;
        lapd_status status = lapd_image_create_gray(
            context.get(), voxels, grid.dims.data(), grid.strides ? grid.strides->data() : nullptr,
            grid.origin.data(), grid.spacing.data(), grid.direction.data(), isovalues.data(),
            isovalues.size(), labels.empty() ? nullptr : labels.data(), &handle);
        return adopt(context, status, handle);
    }
    static image read_gray(context &context, const std::string &path,
                           const std::vector<double> &isovalues,
                           const std::vector<std::int32_t> &labels = {},
                           lapd_world_frame world = LAPD_WORLD_AS_STORED) {
        check_count(labels, isovalues.size(), "isovalues");
        lapd_image *handle = nullptr;
        lapd_status status = lapd_image_read_gray(
            context.get(), path.c_str(), world, isovalues.data(), isovalues.size(),
            labels.empty() ? nullptr : labels.data(), &handle);
        return adopt(context, status, handle);
    }

    /// Probability maps, one for each label; each points to voxel (0, 0, 0).
    static image create_probabilities(context &context, const std::vector<const float *> &maps,
                                      const std::vector<std::int32_t> &labels, const grid &grid) {
        return create_maps(lapd_image_create_probabilities, context, maps, labels, grid);
    }
    /// All volumes of all files; without labels these are 1, 2, ...
    static image read_probabilities(context &context, const std::vector<std::string> &paths,
                                    const std::vector<std::int32_t> &labels = {},
                                    lapd_world_frame world = LAPD_WORLD_AS_STORED) {
        return read_maps(lapd_image_read_probabilities, context, paths, labels, world);
    }

    /// Level sets, one for each label: above 0 inside of it, the largest wins.
    static image create_level_sets(context &context, const std::vector<const float *> &maps,
                                   const std::vector<std::int32_t> &labels, const grid &grid) {
        return create_maps(lapd_image_create_level_sets, context, maps, labels, grid);
    }
    static image read_level_sets(context &context, const std::vector<std::string> &paths,
                                 const std::vector<std::int32_t> &labels = {},
                                 lapd_world_frame world = LAPD_WORLD_AS_STORED) {
        return read_maps(lapd_image_read_level_sets, context, paths, labels, world);
    }

    /// Takes over a handle.
    explicit image(lapd_image *handle) noexcept : handle_(handle) {
    }

    std::array<std::size_t, 3> dims() const {
        std::array<std::size_t, 3> values{};
        detail::check(lapd_image_get_dims(get(), values.data()));
        return values;
    }
    std::array<double, 3> origin() const {
        std::array<double, 3> values{};
        detail::check(lapd_image_get_origin(get(), values.data()));
        return values;
    }
    std::array<double, 3> spacing() const {
        std::array<double, 3> values{};
        detail::check(lapd_image_get_spacing(get(), values.data()));
        return values;
    }
    std::array<double, 9> direction() const {
        std::array<double, 9> values{};
        detail::check(lapd_image_get_direction(get(), values.data()));
        return values;
    }
    lapd_world_axes world_axes() const {
        std::int32_t axes = LAPD_AXES_UNKNOWN;
        detail::check(lapd_image_get_world_axes(get(), &axes));
        return static_cast<lapd_world_axes>(axes);
    }
    span<std::int32_t> labels() const {
        const std::int32_t *data = nullptr;
        std::size_t count = 0;
        detail::check(lapd_image_get_labels(get(), &data, &count));
        return {data, count};
    }
    /// A copy: the image keeps its voxels in another form.
    std::vector<std::int32_t> voxels() const {
        const auto n = dims();
        std::vector<std::int32_t> values(n[0] * n[1] * n[2]);
        detail::check(lapd_image_copy_voxels(get(), values.data(), values.size()));
        return values;
    }
    std::size_t warning_count() const {
        std::size_t count = 0;
        detail::check(lapd_image_get_warning_count(get(), &count));
        return count;
    }
    /// What a label stands for in an image read with LAPD_LABELS_DISTINCT.
    const char *value(std::int32_t label) const {
        const char *text = nullptr;
        detail::check(lapd_image_get_value(get(), label, &text));
        return text;
    }
    /// Sets the sides of a voxel; no other thread may use the image meanwhile.
    void set_spacing(context &context, const std::array<double, 3> &spacing) {
        context.check(lapd_image_set_spacing(context.get(), get(), spacing.data()));
    }
    /// Names a label; no other thread may use the image meanwhile.
    void set_label_name(context &context, std::int32_t label, const std::string &name) {
        context.check(lapd_image_set_label_name(context.get(), get(), label, name.c_str()));
    }
    /// Names labels by a table of 3D Slicer, FreeSurfer, ITK-SNAP, or a plain list.
    void read_label_names(context &context, const std::string &path) {
        context.check(lapd_image_read_label_names(context.get(), get(), path.c_str()));
    }
    /// The name of a label; nullptr where it has none.
    const char *label_name(std::int32_t label) const {
        const char *text = nullptr;
        detail::check(lapd_image_get_label_name(get(), label, &text));
        return text;
    }
    const char *warning(std::size_t index) const {
        const char *text = nullptr;
        detail::check(lapd_image_get_warning(get(), index, &text));
        return text;
    }

    lapd_image *get() const noexcept {
        return handle_.get();
    }

  private:
    /// By the C function for probabilities, or that for level sets.
    template <class Create>
    static image create_maps(Create *create, context &context,
                             const std::vector<const float *> &maps,
                             const std::vector<std::int32_t> &labels, const grid &grid) {
        check_count(labels, maps.size(), "maps");
        lapd_image *handle = nullptr;
        lapd_status status =
            create(context.get(), maps.data(), labels.data(), maps.size(), grid.dims.data(),
                   grid.strides ? grid.strides->data() : nullptr, grid.origin.data(),
                   grid.spacing.data(), grid.direction.data(), &handle);
        return adopt(context, status, handle);
    }
    template <class Read>
    static image read_maps(Read *read, context &context, const std::vector<std::string> &paths,
                           const std::vector<std::int32_t> &labels, lapd_world_frame world) {
        std::vector<const char *> names;
        for (const std::string &path : paths)
            names.push_back(path.c_str());
        lapd_image *handle = nullptr;
        lapd_status status = read(context.get(), names.data(), names.size(), world,
                                  labels.empty() ? nullptr : labels.data(), labels.size(), &handle);
        return adopt(context, status, handle);
    }

    /// The C function takes one count for both.
    static void check_count(const std::vector<std::int32_t> &labels, std::size_t count,
                            const char *what) {
        if (!labels.empty() && labels.size() != count)
            throw error(LAPD_ERROR_INVALID_ARGUMENT,
                        "as many labels as " + std::string(what) + " are needed");
    }

    /// Owns first, so that what was made is freed when this throws.
    static image adopt(const context &context, lapd_status status, lapd_image *handle) {
        image made(handle);
        context.check(status);
        return made;
    }

    std::unique_ptr<lapd_image, detail::deleter<lapd_image, lapd_image_free>> handle_;
};

/// lapd_params: the defaults, until changed. Setters return the object, so that they can be written
/// in a row.
class params {
  public:
    params() {
        lapd_params *handle = nullptr;
        detail::check(lapd_params_create(&handle));
        handle_.reset(handle);
    }

    params &set_delta(double delta) {
        return set(lapd_params_set_delta, delta);
    }
    params &set_size(double size) {
        return set(lapd_params_set_size, size);
    }
    params &set_label_size(std::int32_t label, double size) {
        return set(lapd_params_set_label_size, label, size);
    }
    params &clear_label_sizes() {
        return set(lapd_params_clear_label_sizes);
    }
    params &set_radius_edge(double radius_edge) {
        return set(lapd_params_set_radius_edge, radius_edge);
    }
    params &set_facet_angle(double degrees) {
        return set(lapd_params_set_facet_angle, degrees);
    }
    params &set_surface(lapd_surface surface) {
        return set(lapd_params_set_surface, surface);
    }
    params &set_sigma(double sigma) {
        return set(lapd_params_set_sigma, sigma);
    }
    params &set_border(lapd_border border) {
        return set(lapd_params_set_border, border);
    }
    params &set_merge(const std::vector<std::int32_t> &labels, std::int32_t target) {
        return set(lapd_params_set_merge, labels.data(), labels.size(), target);
    }
    params &clear_merge() {
        return set(lapd_params_clear_merge);
    }
    params &set_background_label(std::int32_t label) {
        return set(lapd_params_set_background_label, label);
    }
    params &set_keep(const std::vector<std::int32_t> &labels) {
        return set(lapd_params_set_keep, labels.data(), labels.size());
    }
    params &set_background(bool background) {
        return set(lapd_params_set_background, background);
    }
    params &set_threads(std::size_t threads) {
        return set(lapd_params_set_threads, threads);
    }
    params &set_max_vertices(std::size_t max_vertices) {
        return set(lapd_params_set_max_vertices, max_vertices);
    }
    params &set_time_limit(double seconds) {
        return set(lapd_params_set_time_limit, seconds);
    }
    params &set_max_memory(std::uint64_t bytes) {
        return set(lapd_params_set_max_memory, bytes);
    }
    params &set_partial(bool partial) {
        return set(lapd_params_set_partial, partial);
    }
    params &set_algorithm(lapd_algorithm algorithm) {
        return set(lapd_params_set_algorithm, algorithm);
    }
    params &set_contention(lapd_contention contention) {
        return set(lapd_params_set_contention, contention);
    }
    params &set_begging(lapd_begging begging) {
        return set(lapd_params_set_begging, begging);
    }
    params &set_topology(const std::string &description) {
        return set(lapd_params_set_topology, description.c_str());
    }
    params &set_adaptive(lapd_adaptive adaptive) {
        return set(lapd_params_set_adaptive, adaptive);
    }
    params &set_spacing_floor(double spacing_floor) {
        return set(lapd_params_set_spacing_floor, spacing_floor);
    }
    params &set_min_voxels(std::uint64_t min_voxels) {
        return set(lapd_params_set_min_voxels, min_voxels);
    }
    params &set_target_tets(std::uint64_t tets) {
        return set(lapd_params_set_target_tets, tets);
    }
    params &set_across(double elements) {
        return set(lapd_params_set_across, elements);
    }
    params &set_least_size(double least_size) {
        return set(lapd_params_set_least_size, least_size);
    }
    params &set_gradation(double gradation) {
        return set(lapd_params_set_gradation, gradation);
    }
    params &set_coarsen(double degrees) {
        return set(lapd_params_set_coarsen, degrees);
    }
    params &set_count_accesses(bool count_accesses) {
        return set(lapd_params_set_count_accesses, count_accesses);
    }
    params &set_bind(bool bind) {
        return set(lapd_params_set_bind, bind);
    }
    params &set_timeline(bool timeline) {
        return set(lapd_params_set_timeline, timeline);
    }
    params &set_improve(lapd_improve improve) {
        return set(lapd_params_set_improve, improve);
    }
    params &set_certificate(lapd_certificate_level level) {
        return set(lapd_params_set_certificate, level);
    }
    params &set_target_dihedral(double degrees) {
        return set(lapd_params_set_target_dihedral, degrees);
    }

    params &set_order(std::int32_t order) {
        return set(lapd_params_set_order, order);
    }
    params &set_curved(bool curved) {
        return set(lapd_params_set_curved, curved);
    }

    double delta() const {
        return value<double>(lapd_params_get_delta);
    }
    double size() const {
        return value<double>(lapd_params_get_size);
    }
    double label_size(std::int32_t label) const {
        double size = 0;
        detail::check(lapd_params_get_label_size(get(), label, &size));
        return size;
    }
    std::int32_t merge(std::int32_t label) const {
        std::int32_t target = 0;
        detail::check(lapd_params_get_merge(get(), label, &target));
        return target;
    }
    std::int32_t background_label() const {
        return value<std::int32_t>(lapd_params_get_background_label);
    }
    double radius_edge() const {
        return value<double>(lapd_params_get_radius_edge);
    }
    double facet_angle() const {
        return value<double>(lapd_params_get_facet_angle);
    }
    lapd_surface surface() const {
        return static_cast<lapd_surface>(value<std::int32_t>(lapd_params_get_surface));
    }
    double sigma() const {
        return value<double>(lapd_params_get_sigma);
    }
    lapd_border border() const {
        return static_cast<lapd_border>(value<std::int32_t>(lapd_params_get_border));
    }
    span<std::int32_t> keep() const {
        const std::int32_t *data = nullptr;
        std::size_t count = 0;
        detail::check(lapd_params_get_keep(get(), &data, &count));
        return {data, count};
    }
    bool background() const {
        return value<std::int32_t>(lapd_params_get_background) != 0;
    }
    std::size_t threads() const {
        return value<std::size_t>(lapd_params_get_threads);
    }
    std::size_t max_vertices() const {
        return value<std::size_t>(lapd_params_get_max_vertices);
    }
    double time_limit() const {
        return value<double>(lapd_params_get_time_limit);
    }
    std::uint64_t max_memory() const {
        return value<std::uint64_t>(lapd_params_get_max_memory);
    }
    bool partial() const {
        return value<std::int32_t>(lapd_params_get_partial) != 0;
    }
    lapd_algorithm algorithm() const {
        return static_cast<lapd_algorithm>(value<std::int32_t>(lapd_params_get_algorithm));
    }
    lapd_contention contention() const {
        return static_cast<lapd_contention>(value<std::int32_t>(lapd_params_get_contention));
    }
    lapd_begging begging() const {
        return static_cast<lapd_begging>(value<std::int32_t>(lapd_params_get_begging));
    }
    std::string topology() const {
        return value<const char *>(lapd_params_get_topology);
    }
    lapd_adaptive adaptive() const {
        return static_cast<lapd_adaptive>(value<std::int32_t>(lapd_params_get_adaptive));
    }
    double spacing_floor() const {
        return value<double>(lapd_params_get_spacing_floor);
    }
    std::uint64_t target_tets() const {
        return value<std::uint64_t>(lapd_params_get_target_tets);
    }
    double across() const {
        return value<double>(lapd_params_get_across);
    }
    double least_size() const {
        return value<double>(lapd_params_get_least_size);
    }
    double gradation() const {
        return value<double>(lapd_params_get_gradation);
    }
    double coarsen() const {
        return value<double>(lapd_params_get_coarsen);
    }
    std::uint64_t min_voxels() const {
        return value<std::uint64_t>(lapd_params_get_min_voxels);
    }
    bool count_accesses() const {
        return value<std::int32_t>(lapd_params_get_count_accesses) != 0;
    }
    bool bind() const {
        return value<std::int32_t>(lapd_params_get_bind) != 0;
    }
    bool timeline() const {
        return value<std::int32_t>(lapd_params_get_timeline) != 0;
    }
    lapd_improve improve() const {
        return static_cast<lapd_improve>(value<std::int32_t>(lapd_params_get_improve));
    }
    lapd_certificate_level certificate() const {
        return static_cast<lapd_certificate_level>(
            value<std::int32_t>(lapd_params_get_certificate));
    }
    double target_dihedral() const {
        return value<double>(lapd_params_get_target_dihedral);
    }
    std::int32_t order() const {
        return value<std::int32_t>(lapd_params_get_order);
    }
    bool curved() const {
        return value<std::int32_t>(lapd_params_get_curved) != 0;
    }

    lapd_params *get() const noexcept {
        return handle_.get();
    }

  private:
    template <class Function, class... Arguments>
    params &set(Function function, Arguments... arguments) {
        messages_.check(function(messages_.get(), get(), arguments...));
        return *this;
    }
    template <class T> T value(lapd_status (*function)(const lapd_params *, T *)) const {
        T result{};
        detail::check(function(get(), &result));
        return result;
    }

    /// Setters leave their message here.
    context messages_;
    std::unique_ptr<lapd_params, detail::deleter<lapd_params, lapd_params_free>> handle_;
};

/// lapd_write_options: how a file of a mesh is written.
class write_options {
  public:
    write_options() {
        lapd_write_options *handle = nullptr;
        detail::check(lapd_write_options_create(&handle));
        handle_.reset(handle);
    }
    /// Measures of the tets in .vtu files.
    write_options &set_measures(bool measures) {
        messages_.check(lapd_write_options_set_measures(messages_.get(), get(), measures));
        return *this;
    }
    /// Each connected part of a boundary is one of its own.
    write_options &set_boundary_parts(bool parts) {
        messages_.check(lapd_write_options_set_boundary_parts(messages_.get(), get(), parts));
        return *this;
    }

    lapd_write_options *get() const noexcept {
        return handle_.get();
    }

  private:
    /// Setters leave their message here.
    context messages_;
    std::unique_ptr<lapd_write_options,
                    detail::deleter<lapd_write_options, lapd_write_options_free>>
        handle_;
};

/// What a mesh will need, before it is made.
struct expected_use {
    /// Tets of labels.
    std::uint64_t tets = 0;
    /// Bytes of memory at the peak, the image among them.
    std::uint64_t peak_bytes = 0;
    /// On this machine, with the threads that are asked for.
    double seconds = 0;
};

/// lapd_image_estimate.
inline expected_use estimate(context &context, const image &image, const params &params) {
    expected_use use;
    context.check(lapd_image_estimate(context.get(), image.get(), params.get(), &use.tets,
                                      &use.peak_bytes, &use.seconds));
    return use;
}

/// lapd_mesh: any number of threads, unless one certifies it or splits its interfaces; needs none
/// of the other objects to live on.
class mesh {
  public:
    /// lapd_mesh_image. A partial mesh, where the parameters ask for it, is returned too;
    /// limit_reached() tells.
    static mesh make(context &context, const image &image, const params &params) {
        lapd_mesh *handle = nullptr;
        lapd_status status = lapd_mesh_image(context.get(), image.get(), params.get(), &handle);
        mesh made(handle);
        context.check(handle != nullptr ? LAPD_OK : status);
        return made;
    }

    /// lapd_mesh_from_arrays: a mesh that another program made. `points` has 3 values a vertex,
    /// `tets` 4 a tet, `labels` one.
    static mesh from_arrays(context &context, const std::vector<double> &points,
                            const std::vector<std::uint32_t> &tets,
                            const std::vector<std::int32_t> &labels) {
        if (points.size() % 3 != 0 || tets.size() != 4 * labels.size()) {
            throw error(LAPD_ERROR_INVALID_ARGUMENT,
                        "points have 3 values a vertex, tets 4 a tet, labels 1 a tet");
        }
        lapd_mesh *handle = nullptr;
        context.check(lapd_mesh_from_arrays(context.get(), points.data(), points.size() / 3,
                                            tets.data(), labels.size(), labels.data(), &handle));
        return mesh(handle);
    }

    /// Throws for a name that write() would not take for its ending, before there is a mesh.
    static void check_path(context &context, const std::string &path) {
        context.check(lapd_mesh_check_path(context.get(), path.c_str()));
    }

    /// Takes over a handle.
    explicit mesh(lapd_mesh *handle) noexcept : handle_(handle) {
    }

    void write(context &context, const std::string &path) const {
        context.check(lapd_mesh_write(context.get(), get(), path.c_str()));
    }
    /// lapd_mesh_write_with: with choices.
    void write(context &context, const std::string &path, const write_options &options) const {
        context.check(lapd_mesh_write_with(context.get(), get(), path.c_str(), options.get()));
    }
    /// lapd_mesh_certify: measures the certificate, or what it lacks.
    void certify(context &context, const image &image, const params &params) {
        context.check(lapd_mesh_certify(context.get(), get(), image.get(), params.get()));
    }
    /// lapd_mesh_split_interfaces: of these pairs of labels, or all. Views got before are invalid.
    void split_interfaces(context &context,
                          const std::vector<std::array<std::int32_t, 2>> &pairs = {}) {
        const std::int32_t *first = pairs.empty() ? nullptr : pairs.front().data();
        context.check(lapd_mesh_split_interfaces(context.get(), get(), first, pairs.size()));
    }
    /// The nodes that this made, each behind the one that it is a copy of.
    rows<std::uint32_t, 2> node_pairs() const {
        return array<rows<std::uint32_t, 2>>(lapd_mesh_get_node_pairs);
    }
    /// A measure of every tet.
    std::vector<double> measure(lapd_tet_measure measure) const {
        std::vector<double> values(tets().size());
        detail::check(lapd_mesh_copy_measure(get(), measure, values.data(), values.size()));
        return values;
    }
    /// The report as JSON; `extra`, if not empty, is a JSON object of members to put beside.
    void write_report(context &context, const std::string &path,
                      const std::string &extra = {}) const {
        context.check(lapd_mesh_write_report(context.get(), get(), path.c_str(),
                                             extra.empty() ? nullptr : extra.c_str()));
    }
    /// The name of a label; nullptr where it has none.
    const char *label_name(std::int32_t label) const {
        const char *text = nullptr;
        detail::check(lapd_mesh_get_label_name(get(), label, &text));
        return text;
    }
    /// Red, green and blue of a label, and whether it has a colour.
    std::pair<std::array<std::uint8_t, 3>, bool> label_color(std::int32_t label) const {
        std::array<std::uint8_t, 3> color{};
        std::int32_t known = 0;
        detail::check(lapd_mesh_get_label_color(get(), label, color.data(), &known));
        return {color, known != 0};
    }
    void write_timeline(context &context, const std::string &path) const {
        context.check(lapd_mesh_write_timeline(context.get(), get(), path.c_str()));
    }

    rows<double, 3> points() const {
        return array<rows<double, 3>>(lapd_mesh_get_points);
    }
    rows<std::uint32_t, 4> tets() const {
        return array<rows<std::uint32_t, 4>>(lapd_mesh_get_tets);
    }
    span<std::int32_t> labels() const {
        return array<span<std::int32_t>>(lapd_mesh_get_labels);
    }
    rows<std::uint32_t, 4> neighbors() const {
        return array<rows<std::uint32_t, 4>>(lapd_mesh_get_neighbors);
    }
    rows<std::uint32_t, 3> facets() const {
        return array<rows<std::uint32_t, 3>>(lapd_mesh_get_facets);
    }
    rows<std::int32_t, 2> facet_labels() const {
        return array<rows<std::int32_t, 2>>(lapd_mesh_get_facet_labels);
    }
    rows<std::uint32_t, 2> facet_tets() const {
        return array<rows<std::uint32_t, 2>>(lapd_mesh_get_facet_tets);
    }
    /// The face of the image's box that each facet lies on, a lapd_wall; none where no image is
    /// known.
    span<std::uint8_t> facet_walls() const {
        return array<span<std::uint8_t>>(lapd_mesh_get_facet_walls);
    }
    /// The nodes on the edges of tets and facets; no rows in a mesh of order 1.
    rows<std::uint32_t, 6> tet_mid_nodes() const {
        return array<rows<std::uint32_t, 6>>(lapd_mesh_get_tet_mid_nodes);
    }
    rows<std::uint32_t, 3> facet_mid_nodes() const {
        return array<rows<std::uint32_t, 3>>(lapd_mesh_get_facet_mid_nodes);
    }

    /** LAPD_OK for a complete mesh, or the status of the limit that ended the refinement of a
     * partial one. */
    lapd_status limit_reached() const {
        std::int32_t limit = LAPD_OK;
        detail::check(lapd_mesh_get_limit_reached(get(), &limit));
        return static_cast<lapd_status>(limit);
    }
    /// What it was made with: the distance of samples, the largest circumradius.
    std::array<double, 2> bounds() const {
        std::array<double, 2> bounds{};
        detail::check(lapd_mesh_get_bounds(get(), &bounds[0], &bounds[1]));
        return bounds;
    }
    lapd_counts counts() const {
        return filled<lapd_counts>(lapd_mesh_get_counts);
    }
    lapd_timings timings() const {
        return filled<lapd_timings>(lapd_mesh_get_timings);
    }
    lapd_operations operations() const {
        return filled<lapd_operations>(lapd_mesh_get_operations);
    }
    lapd_quality quality() const {
        return filled<lapd_quality>(lapd_mesh_get_quality);
    }
    lapd_certificate certificate() const {
        return filled<lapd_certificate>(lapd_mesh_get_certificate);
    }
    std::size_t label_row_count() const {
        std::size_t count = 0;
        detail::check(lapd_mesh_get_label_row_count(get(), &count));
        return count;
    }
    lapd_label_row label_row(std::size_t index) const {
        lapd_label_row row{};
        row.struct_size = sizeof row;
        detail::check(lapd_mesh_get_label_row(get(), index, &row));
        return row;
    }
    std::size_t component_row_count() const {
        std::size_t count = 0;
        detail::check(lapd_mesh_get_component_row_count(get(), &count));
        return count;
    }
    lapd_component_row component_row(std::size_t index) const {
        lapd_component_row row{};
        row.struct_size = sizeof row;
        detail::check(lapd_mesh_get_component_row(get(), index, &row));
        return row;
    }
    std::size_t defect_count() const {
        std::size_t count = 0;
        detail::check(lapd_mesh_get_defect_count(get(), &count));
        return count;
    }
    lapd_defect defect(std::size_t index) const {
        lapd_defect place{};
        place.struct_size = sizeof place;
        detail::check(lapd_mesh_get_defect(get(), index, &place));
        return place;
    }
    lapd_second_order second_order() const {
        return filled<lapd_second_order>(lapd_mesh_get_second_order);
    }
    lapd_improvement improvement() const {
        return filled<lapd_improvement>(lapd_mesh_get_improvement);
    }
    std::size_t left_count() const {
        std::size_t count = 0;
        detail::check(lapd_mesh_get_left_count(get(), &count));
        return count;
    }
    lapd_left left(std::size_t index) const {
        lapd_left tet{};
        tet.struct_size = sizeof tet;
        detail::check(lapd_mesh_get_left(get(), index, &tet));
        return tet;
    }
    std::size_t thread_count() const {
        std::size_t count = 0;
        detail::check(lapd_mesh_get_thread_count(get(), &count));
        return count;
    }
    /// Of LAPD_ALL_THREADS: the sum.
    lapd_thread_report thread_report(std::size_t index) const {
        lapd_thread_report report{};
        report.struct_size = sizeof report;
        detail::check(lapd_mesh_get_thread_report(get(), index, &report));
        return report;
    }

    lapd_mesh *get() const noexcept {
        return handle_.get();
    }

  private:
    template <class View, class T>
    View array(lapd_status (*function)(const lapd_mesh *, const T **, std::size_t *)) const {
        const T *data = nullptr;
        std::size_t count = 0;
        detail::check(function(get(), &data, &count));
        return View(data, count);
    }
    template <class T> T filled(lapd_status (*function)(const lapd_mesh *, T *)) const {
        T value{};
        value.struct_size = sizeof value;
        detail::check(function(get(), &value));
        return value;
    }

    std::unique_ptr<lapd_mesh, detail::deleter<lapd_mesh, lapd_mesh_free>> handle_;
};

} // namespace lapd

#if __cplusplus >= 202002L
/// Views own nothing: iterators outlive them.
template <class T> inline constexpr bool std::ranges::enable_view<lapd::span<T>> = true;
template <class T> inline constexpr bool std::ranges::enable_borrowed_range<lapd::span<T>> = true;
#endif

#endif
